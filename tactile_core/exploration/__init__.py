"""Report, section VI: rays, the environment, and policies that choose the next ray."""
