"""One run of a system: plan, start, steps, records, and the runs with which its coupling error is estimated."""
