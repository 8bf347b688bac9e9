"""What the mutation benchmark calls alike by bounds is alike, and nothing else is."""

from __future__ import annotations

import pytest

from benchmarks.mutation.inside_ranges import alike_inside_ranges

_SOURCE = """
m_status_t m_step(m_state_t *s, const m_params_t *p, const m_in_t *u, m_out_t *y)
{
    (void)s;
    m_status_t status = M_OK;
    m_real x = u->x;
    if (!((u->x >= 0.0f) && (u->x <= 1.0f))) {
        x = m_clamped(u->x, 0.0f, 1.0f, 0.0f, &status);
    }
    const m_real below = m_minimum(0.0f, x - 0.0f) * 5.0f;
    const m_real side = (x < 1.0f) ? m_maximum((x - 0.5f) * 2.0f, 0.0f)
        : ((x - 1.0f) * 0.0f) + 1.0f;
    y->sum = (below * p->a) + side;
    y->least = m_minimum(2.0f, x);
    for (uint32_t i = 0U; i < 3U; i++) {
        y->list[i] = 0.0f;
    }
    y->list[2U] = x;
    return status;
}
"""


@pytest.mark.parametrize(
    ("before", "after", "alike"),
    [
        ("* 5.0f", "* 5.051f", True),  # of 0
        ("(below * p->a)", "(0.001f * p->a)", False),
        ("(below * p->a) + side", "side", False),  # a parameter may be infinite
        ("x - 0.0f", "x - 0.001f", False),
        ("(x - 1.0f) * 0.0f", "(x + 1.0f) * 0.0f", True),
        ("(x - 1.0f) * 0.0f", "(x - 1.0f) * 0.001f", True),  # chosen at x = 1 alone
        ("+ 1.0f;", "+ 1.01f;", False),
        ("(x - 0.5f)", "(x - 0.506f)", False),
        ("(x < 1.0f)", "(x < 1.011f)", True),  # both sides are 1 there
        ("(x < 1.0f)", "(x < 0.9f)", False),
        ("m_minimum(2.0f, x)", "m_minimum(2.021f, x)", True),
        ("m_minimum(2.0f, x)", "m_minimum(0.9f, x)", False),
        ("i < 3U", "i < 2U", True),  # written again
        ("i < 3U", "i < 1U", False),
        ("list[2U] = x", "list[1U] = x", False),
        ("(u->x >= 0.0f)", "(u->x >= 0.001f)", False),
        ("u->x <= 1.0f", "u->x <= 1.011f", False),
    ],
)
def test_only_what_no_clamped_input_can_show_is_alike(
    before: str, after: str, *, alike: bool
) -> None:
    assert alike_inside_ranges(_SOURCE, _SOURCE.replace(before, after, 1), "m_step") == alike
