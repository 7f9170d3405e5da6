"""From a recording and a recipe to a bridge folder: plan, run, publish."""
