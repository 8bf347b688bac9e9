/* The same as `other_tools_mlp.c` of the filter's plant. Plans: y and the control of each sample,
 * y at the end; p: y, 29 samples of the control, the speed, 21 of what is wanted. */
#define main prototype_main
#include "prototypes/mpc_condensed.c"
#undef main
#undef N
#undef L

#include "plan.h"
#include "plant_mpc.h"

#include "judge_fir.h"
#include "timed.h"

static plant_mpc_t controller;

void begin(void) { plant_mpc_init(&controller); }

void next_state(const D *p, D u, D *next)
{
    D controls[HORIZON] = {u}, y[HORIZON + 1];
    blend(p[WINDOW]);
    roll(p[0], p + 1, controls, y);
    next[0] = y[1];
}

D off_by(const D *p, const D *plan, const D *multipliers)
{
    D u[HORIZON], m[4][HORIZON];
    for (int k = 0; k < HORIZON; k++) {
        u[k] = plan[2 * k + 1];
        for (int i = 0; i < 4; i++) {
            const D multiplier = multipliers[2 * k + (i < 2 ? 1 : 2)];
            m[i][k] = fmax(i % 2 ? multiplier : -multiplier, 0);
        }
    }
    blend(p[WINDOW]);
    return judged(p[0], p + 1, p + WINDOW + 1, u, m);
}

D own(const D *p, D *plan, D *multipliers, int *status)
{
    plant_mpc_in_t in;
    plant_mpc_out_t out;
    memcpy(in.x, p, sizeof in.x);
    in.v = p[WINDOW];
    memcpy(in.r, p + WINDOW + 1, sizeof in.r);
    static plant_mpc_t before;
    D shortest = INFINITY;
    before = controller;
    for (int i = 0; i < TIMES; i++) {
        controller = before;
        const D begun = now();
        *status = plant_mpc_solve(&controller, &in, &out);
        shortest = fmin(shortest, now() - begun);
    }
    for (int k = 0; k <= HORIZON; k++) {
        const D *m = controller.multiplier[k];
        plan[2 * k] = controller.z[PLAN_Y + k];
        multipliers[2 * k] = k > 0 ? m[3] - m[2] : 0;
        if (k == HORIZON) break;
        plan[2 * k + 1] = controller.z[PLAN_U + k];
        multipliers[2 * k + 1] = m[1] - m[0];
    }
    return 1e-3 * shortest;
}
