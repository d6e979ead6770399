"""Components in separate processes, so that a failure that ends such a process does not end this one."""
