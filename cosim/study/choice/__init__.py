"""From rows to a choice: which corner matters, what differs beyond its uncertainty, what to confirm on the rig."""
