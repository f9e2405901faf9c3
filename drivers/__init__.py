"""Real instruments: synchronous drivers, engineering units in and out."""
