"""From moment tables to the water."""
