"""What rays feel, for training the U-Net on what it will meet."""
