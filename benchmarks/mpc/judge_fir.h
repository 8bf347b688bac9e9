/* Judges plans of the filter's plant by neither solver; to be included after the prototype, for
 * its plant. */
enum { HORIZON = 20, WINDOW = 30 };

/* The largest error of the optimality conditions at controls with multipliers of all bounds. */
static D judged(D y0, const D *past, const D *r, const D *u, const D m[4][HORIZON])
{
    D y[HORIZON + 1], by[HORIZON] = {0}, worst = 0, costate = 0;
    roll(y0, past, u, y);
    for (int k = HORIZON; k-- > 0;) {
        const D th = tanh(y[k + 1]), f = k + 1 < HORIZON ? alpha + 0.02 * (1 - th * th) : 0;
        costate = f * costate + 2 * (y[k + 1] - r[k + 1]) + m[3][k] - m[2][k];
        for (int j = 0; j < WINDOW && j <= k; j++) by[k - j] += costate * h[WINDOW - 1 - j];
    }
    for (int k = 0; k < HORIZON; k++) {
        const D room[4] = {u[k] + 3, 3 - u[k], y[k + 1] + 9, 9 - y[k + 1]};
        worst = fmax(worst, fabs(by[k] + 2e-3 * u[k] + m[1][k] - m[0][k]));
        for (int i = 0; i < 4; i++) {
            worst = fmax(worst, fmax(fabs(m[i][k] * room[i]), fmax(-m[i][k], -room[i])));
            if (!(room[i] == room[i] && m[i][k] == m[i][k])) return INFINITY;
        }
    }
    return worst;
}
