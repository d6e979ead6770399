"""What is simulated: systems of components with bonds and connections, scenarios, and coupling algorithms."""
