"""Calls the functions of a model with random numbers, and computes a hash of all results.

Numbers have arbitrary bits, or any size around 1, or are small integers, 0, infinite or NaN. They
are used for states, inputs, samples of `reset` and parameters.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

from msnn.verification.exported_c import ExportedC

_MAIN = """
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include "{prefix}.h"

static uint64_t state = 88172645463325252U;
static uint64_t hash = 14695981039346656037U;

static uint32_t drawn(void)
{{
    state ^= state << 13U; state ^= state >> 7U; state ^= state << 17U;
    return (uint32_t)(state >> 32U);
}}

static float number(void)
{{
    const uint32_t kind = drawn() % 16U;
    const float unit = (float)(drawn() >> 8U) / 8388608.0f - 1.0f;
    if (kind == 0U) {{ uint32_t bits = drawn(); float x; memcpy(&x, &bits, 4U); return x; }}
    if (kind == 1U) {{ return 0.0f; }}
    if (kind == 2U) {{ return (drawn() % 8U == 0U) ? NAN : ((drawn() % 2U) ? INFINITY : unit); }}
    if (kind < 6U) {{ return (float)((int)(drawn() % 9U) - 4); }}
    if (kind < 9U) {{ return ldexpf(unit, (int)(drawn() % 24U) - 12); }}
    if (kind < 12U) {{ return unit * 50.0f; }}
    return unit;
}}

static void fill(void *place, unsigned count)
{{
    for (unsigned i = 0U; i < count; i++) {{
        const float x = number();
        memcpy((char *)place + (4U * i), &x, 4U);
    }}
}}

static void see(const void *place, unsigned count)
{{
    for (unsigned i = 0U; i < count; i++) {{
        float x; uint32_t bits;
        memcpy(&x, (const char *)place + (4U * i), 4U);
        memcpy(&bits, &x, 4U);
        hash = (hash ^ ((x != x) ? 0x7fc00000U : bits)) * 1099511628211U;
    }}
}}

int main(void)
{{
    for (unsigned k = 0U; k < {calls}U; k++) {{
        {prefix}_state_t s;
        {prefix}_init_t x0;
        {prefix}_in_t u;
        {prefix}_out_t y;
        {parameters}
        memset(&s, 0, sizeof s);
        memset(&x0, 0, sizeof x0);
        memset(&u, 0, sizeof u);
        memset(&y, 0, sizeof y);
        {fill_start}
        uint32_t status = 0U;
        if (drawn() % 4U == 0U) {{
            {prefix}_init(&s{p});
        }} else {{
            status = {prefix}_reset(&s{p}, &x0);
        }}
        see(&status, 1U);
        if (drawn() % 2U == 0U) {{
            {fill_state}
        }}
        for (unsigned step = 0U; step < 2U; step++) {{
            {fill_inputs}
            {linearize}
            status = {prefix}_step(&s{p}, &u, &y);
            see(&status, 1U);
            see(&y, sizeof y / 4U);
        }}
        see(&s, sizeof s / 4U);
    }}
    printf("%llx\\n", (unsigned long long)hash);
    return 0;
}}
"""
_LINEARIZE = """static {prefix}_jacobian_t jac;
            memset(&jac, 0, sizeof jac);
            status = {prefix}_linearize(&s{p}, &u, &jac);
            see(&status, 1U);
            see(&jac, sizeof jac / 4U);"""
_PARAMETERS = """static {prefix}_params_t p;
        p = {prefix}_params_default;
        for (unsigned i = 0U; i < (unsigned)(sizeof p / 4U); i++) {{
            if (drawn() % 8U == 0U) {{ fill((char *)&p + (4U * i), 1U); }}
        }}"""


def random_calls(model: ExportedC, calls: int) -> str:
    """The C text of a program that prints a hash of all results of `calls` random calls; float32
    only.
    """
    p = ", &p" if model.takes_parameters else ""

    def fill(base: str, members: tuple[tuple[str, int | None, bool], ...]) -> str:
        reals = [(field, size or 1) for field, size, unsigned in members if not unsigned]
        return " ".join(f"fill(&{base}.{field}, {size}U);" for field, size in reals)

    start, state, inputs = (
        tuple((m.field, m.size, m.unsigned) for m in members)
        for members in (model.start, model.state, model.inputs)
    )
    return _MAIN.format(
        prefix=model.prefix,
        calls=calls,
        p=p,
        parameters=_PARAMETERS.format(prefix=model.prefix) if model.takes_parameters else "",
        fill_start=fill("x0", start),
        fill_state=fill("s", state),
        fill_inputs=fill("u", inputs),
        linearize=_LINEARIZE.format(prefix=model.prefix, p=p) if model.linearizes else "",
    )


def answers(program: Path) -> str:
    """The output of the program."""
    return subprocess.run([program], check=True, capture_output=True, text=True).stdout
