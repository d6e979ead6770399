"""Grey-box cars: a family of physical models with friction, for the recipe grey-box."""
