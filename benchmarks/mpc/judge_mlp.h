/* Judges plans of the network's plant by neither solver; to be included after the prototype, for
 * its plant, and the generated controller `plant`. */
enum { HORIZON = 20 };

/* The largest error of the optimality conditions of a plan with multipliers of its bounds. */
static D judged(const D w[HORIZON + 1][3], const D low[HORIZON + 1][3], const D high[HORIZON + 1][3])
{
    D worst = 0, costate[2] = {0, 0};
    for (int k = HORIZON; k >= 0; k--) {
        D next[2], j[2][3] = {{0}}, h[3][3], nothing[2] = {0, 0}, by[3] = {0, 0, 0};
        const int n = k == HORIZON ? 2 : 3;
        if (k < HORIZON) {
            f2(w[k], nothing, next, j, h);
            for (int i = 0; i < 2; i++) worst = fmax(worst, fabs(next[i] - w[k + 1][i]));
        }
        for (int i = 0; i < n; i++) {
            const int bounded = k > 0 || i == 2;
            by[i] = wt(k, i) * w[k][i] + j[0][i] * costate[0] + j[1][i] * costate[1];
            if (!bounded) continue;
            by[i] += high[k][i] - low[k][i];
            worst = fmax(worst, fabs(low[k][i] * (w[k][i] - LB[i])));
            worst = fmax(worst, fabs(high[k][i] * (UB[i] - w[k][i])));
            worst = fmax(worst, fmax(LB[i] - w[k][i], w[k][i] - UB[i]));
            worst = fmax(worst, fmax(-low[k][i], -high[k][i]));
            if (!(w[k][i] == w[k][i] && by[i] == by[i])) return INFINITY;
        }
        if (k < HORIZON) worst = fmax(worst, fabs(by[2]));
        costate[0] = by[0];
        costate[1] = by[1];
    }
    return worst;
}

static D judged_controller(const plant_mpc_t *c)
{
    static D low[HORIZON + 1][3], high[HORIZON + 1][3];
    for (int k = 0; k <= HORIZON; k++) {
        const int row[3] = {1, 2, 0};
        for (int i = 0; i < 3; i++) {
            low[k][i] = c->multiplier[k][2 * row[i]];
            high[k][i] = c->multiplier[k][2 * row[i] + 1];
        }
    }
    return judged(c->z, low, high);
}
