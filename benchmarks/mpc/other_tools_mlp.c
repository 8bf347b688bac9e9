/* What `other_tools.py` calls of the network's plant: its step, a judge of plans, the generated
 * controller, and a clock around a function that CasADi has generated. Plans lie as in its nlp:
 * both states and the control of each sample, both states at the end. */
#define main prototype_main
#include "prototypes/mpc_staged.c"
#undef main
#undef N

#include "plant_mpc.h"

#include "judge_mlp.h"
#include "timed.h"

static plant_mpc_t controller;

void begin(void) { plant_mpc_init(&controller); }

void next_state(const D *p, D u, D *next)
{
    const D z[3] = {p[0], p[1], u};
    f0(z, next);
}

D off_by(const D *p, const D *plan, const D *multipliers)
{
    static D w[HORIZON + 1][3], low[HORIZON + 1][3], high[HORIZON + 1][3];
    for (int i = 0; i < 3 * HORIZON + 2; i++) {
        w[i / 3][i % 3] = plan[i];
        low[i / 3][i % 3] = fmax(-multipliers[i], 0);
        high[i / 3][i % 3] = fmax(multipliers[i], 0);
    }
    return fmax(judged(w, low, high), fmax(fabs(plan[0] - p[0]), fabs(plan[1] - p[1])));
}

D own(const D *p, D *plan, D *multipliers, int *status)
{
    const plant_mpc_in_t in = {{p[0], p[1]}};
    plant_mpc_out_t out;
    static plant_mpc_t before;
    D shortest = INFINITY;
    before = controller;
    for (int i = 0; i < TIMES; i++) {
        controller = before;
        const D begun = now();
        *status = plant_mpc_solve(&controller, &in, &out);
        shortest = fmin(shortest, now() - begun);
    }
    for (int i = 0; i < 3 * HORIZON + 2; i++) {
        const int row[3] = {1, 2, 0};
        const D *m = controller.multiplier[i / 3] + 2 * row[i % 3];
        plan[i] = controller.z[i / 3][i % 3];
        multipliers[i] = i < 2 ? 0 : m[1] - m[0];
    }
    return 1e-3 * shortest;
}
