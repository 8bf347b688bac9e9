"""Models with integrals, derivatives, gradients and limits, for the tests of training."""

BURGERS = """
inputs: {x: {unit: 1}, tau: {unit: 1}}
targets: {u0: {unit: 1}}
parameters: {nu: {init: 0.05, min: 0}}
layers: {net: {mlp: {hidden: 4}}}
equations:
  u: net(x, tau)
  slope: grad(u, x)
  residual: grad(u, tau) + u * slope - nu * grad(slope, x)
outputs: {y: u}
losses:
  physics: mse(residual, 0)
  data: mse(u, u0)
"""
"""u_t + u u_x = ν u_xx with u a network: gradients of second-order gradients."""

ACCUMULATED = """
inputs: {x: m, u: N}
parameters: {a: 0.6, k: 0.4, i0: 0.2}
layers: {h: {fir: {window: 3}}}
states:
  p: {unit: m, der: v}
  v: {unit: m/s, der: "k * u - a * p - 0.1 * grad(0.5 * k * p * p, p)"}
integrator: semi_implicit
equations:
  e: h(x) - p
  effort: integral(e, init=i0, method=trapezoidal)
outputs:
  y: {expr: "a * x + 0.1 * effort + 0.05 * der(e) + 0.01 * der(v)", predicts: "x[t+1]"}
losses:
  one: mse(y, x[t+1])
  drift: l2(integral(x.meas - y))
  rate: "mse(der(y), der(x, method=forward))"
"""
"""Memory of the step, and of losses beside the log."""

STIFF = """
dims: {joint: 2}
inputs: {u: {dims: joint}}
targets: {z: {dims: joint}}
parameters: {K: {dims: [joint], init: [8, 3]}, c: 2}
states:
  q: {dims: joint, der: w, init: 0.1}
  w: {dims: joint, der: "u - K * sin(q) - c * w * sum(w * w)"}
integrator: {linear_implicit: {substeps: 2}}
outputs: {y: {expr: next(q), predicts: "z[t+1]"}}
"""

SATURATED = """
inputs: {u: {}}
targets: {z: {}}
parameters: {a: 0.95, b: 0.7}
states:
  s: {next: "a * s + b * u", range: [-0.6, 0.4], on_range: saturate}
outputs: {y: {expr: "next(s) + 0.1 * s", predicts: "z[t+1]"}}
"""
"""A state that is at the ends of its range in many rows."""

BETWEEN = """
inputs: {u: {between: linear}, w: {}}
targets: {z: {}}
parameters: {c: 0.6, k: {init: 4, min: 0}, gain: {init: 0.8, max: 3}}
equations: {push: "gain * u * abs(u) + w"}
states:
  p: {der: v, init: z}
  v: {der: "push - k * sin(p) - c * v", init: 0.1}
integrator: {rk4: {substeps: 2}}
outputs: {y: {expr: next(p), predicts: "z[t+1]"}}
"""
"""An input that moves between its samples, through a memoryless equation."""

CALCULUS = {
    "burgers": (BURGERS, ()),
    "accumulated": (ACCUMULATED, ("x",)),
    "stiff": (STIFF, ()),
    "saturated": (SATURATED, ()),
    "between": (BETWEEN, ()),
}
