"""Draws specs out of what fixed point has: filters, layers, sets, tables, functions, choices."""

import random

_VALUES = (
    "taps(u)",
    "filter(w)",
    "mix(concat(u, w))",
    "map(u)",
    "local(w)",
    "tanh({a})",
    "sigmoid({a} - {b})",
    "clip({a}, -1.5, 2)",
    "max({a}, {b}) - min({a}, 1)",
    "where({a} > {b}, {a}, 0.5 * {b})",
    "0.3 * {a} * {b}",
    "abs({a}) / 3",
    "sign({a})",
    "sum(rough(w) * [1, 0.5, -1, 2])",
    "x",
)


def random_spec(seed: int) -> str:
    """A spec with one state and two outputs; the same text for the same seed."""
    drawn = random.Random(seed)
    terms = ["u", "w"]
    for _ in range(6):
        a, b = drawn.choice(terms), drawn.choice(terms)
        terms.append(f"({drawn.choice(_VALUES).format(a=a, b=b)})")
    knots = sorted(drawn.sample(range(-8, 9), 4))
    heights = [round(drawn.uniform(-3, 3), 2) for _ in knots]
    low = round(drawn.uniform(-4, 0), 2)
    policy = drawn.choice(["clamp", "hold", "flag", "trust"])
    return f"""\
msnn: 1
name: drawn
sample_time: 0.1 s
inputs:
  u: {{range: [{low}, 3], on_invalid: {policy}}}
  w: {{range: [-8, 8]}}
layers:
  taps: {{fir: {{window: {drawn.randint(2, 40) / 10} s}}}}
  filter: {{iir: {{num: 1, den: 2}}}}
  mix: {{linear: {{}}}}
  sets: {{fuzzify: {{centers: {knots}}}}}
  rough: {{fuzzify: {{centers: {knots}, membership: rectangular}}}}
  local: {{local_model: {{by: sets(u), cell: {{linear: {{}}}}}}}}
  map: {{interpolation: {{x: {knots}, y: {heights}}}}}
states:
  x: {{next: "0.9 * x + 0.1 * ({terms[-1]})", init: 0.5, range: [-2, 2]}}
outputs:
  first: {{expr: "{terms[-2]}"}}
  second: {{expr: "next(x) + {terms[-3]}"}}
"""
