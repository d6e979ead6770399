"""Response measures, and later the setup study: it needs FMUs only."""
