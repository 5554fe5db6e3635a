"""Report, section IV: from 3D models to masks, outlines and touches."""
