"""What an FMU is made from: its variables and parameters (interface.toml), its model, its modelDescription.xml."""
