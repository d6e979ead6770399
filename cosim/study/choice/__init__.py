"""From a study's rows to a choice: which corner matters, what is better beyond doubt, what to confirm on the rig."""
