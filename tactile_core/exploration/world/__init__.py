"""What a ray meets: circle, rays, the state of an exploration, rewards, environments."""
