"""Child processes: how they start, exchange messages, keep a time limit, and end with their parent.

A crash or a hang of a child is a message in its parent. `process` has what all children need, among it the one that
answers requests one after the other (an isolated FMU, a reader that can crash), `pool` the workers of a study.
"""
