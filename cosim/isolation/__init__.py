"""A component in a process of its own, so that what ends that process does not end ours."""
