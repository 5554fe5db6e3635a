"""Pictures of every stage, as matplotlib figures and as small PNG or GIF bytes.

Every function returns a `Figure` of its own; nothing touches pyplot or a display. `style.png`
turns a figure into the bytes that metadata and docs hold.
"""
