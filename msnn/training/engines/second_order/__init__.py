"""Steps by second-order methods, whatever engine gives residuals and slopes."""
