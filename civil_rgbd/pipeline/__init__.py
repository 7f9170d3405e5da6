"""The method: select images, accumulate points, render depth."""
