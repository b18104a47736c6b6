"""Towns: what stands where; read, made, drawn."""
