"""Report, section V: a U-Net that reconstructs a mask from touches."""
