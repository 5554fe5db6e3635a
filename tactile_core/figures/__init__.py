"""Pictures of every stage, as matplotlib figures and as small PNG or GIF bytes.

Figures are `Figure`s of their own: nothing touches pyplot or a display. `style.png` turns one into
the bytes that metadata and docs hold; an animation is a GIF from the start.
"""
