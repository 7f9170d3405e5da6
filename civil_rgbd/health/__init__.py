"""Is this recording fit? What it lacks for a build, and whether its rig explains its images."""
