"""From a built bridge to a submission, and from the registry back to a bridge."""
