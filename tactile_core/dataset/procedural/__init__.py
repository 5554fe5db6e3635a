"""How mugs and bottles are made where there is no ShapeNet."""
