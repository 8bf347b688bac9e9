"""What layers share: arguments, memory, arrays, initial fits."""
