"""Parts that several layers share: reading of arguments, states, arrays, and initial fits."""
