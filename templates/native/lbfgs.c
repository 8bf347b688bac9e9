/* L-BFGS: Nocedal, Wright, Numerical Optimization (2006), algorithms 7.4 and 7.5, along the slopes of
   one batch. What it has learned of the curvature it keeps for the next one. */
#define LEAST_FALL 1e-15            /* of the total: less is its rounding */
#define LEAST_CURVATURE 1e-14       /* cosine of step and change of slopes: below there is none */

struct curvature {
    int32_t history;                /* pairs that are kept at most */
    int32_t iterations;             /* a batch */
    int32_t looks;                  /* at the total of a batch after the first, about */
    int32_t pairs;                  /* that there are */
    int32_t newest;
    double *steps;                  /* s of every pair: by how much the raw variables changed */
    double *changes;                /* y: by how much the slopes did */
    double *shares;                 /* 1/sᵀy */
    double *along;                  /* room for αs of the directions */
    double *work;                   /* room for five vectors */
};

static void add(double *restrict to, double factor, const double *restrict what)
{
    for (int i = 0; i < PARAMETERS; i++) {
        to[i] += factor * what[i];
    }
}

/* d = −H g by the two loops of algorithm 7.4, with H₀ = sᵀy/yᵀy of the newest pair (7.20). */
static void direction_of(const struct curvature *c, const double *g, double *d)
{
    for (int i = 0; i < PARAMETERS; i++) {
        d[i] = -g[i];
    }
    for (int k = 0; k < c->pairs; k++) {
        const int pair = (c->newest - k + c->history) % c->history;
        c->along[pair] = c->shares[pair] * dot(c->steps + (size_t)pair * PARAMETERS, d);
        add(d, -c->along[pair], c->changes + (size_t)pair * PARAMETERS);
    }
    if (c->pairs > 0) {
        const double *const y = c->changes + (size_t)c->newest * PARAMETERS;
        const double scale = 1.0 / (c->shares[c->newest] * dot(y, y));
        for (int i = 0; i < PARAMETERS; i++) {
            d[i] *= scale;
        }
    }
    for (int k = c->pairs - 1; k >= 0; k--) {
        const int pair = (c->newest - k + c->history) % c->history;
        const double back = c->shares[pair] * dot(c->changes + (size_t)pair * PARAMETERS, d);
        add(d, c->along[pair] - back, c->steps + (size_t)pair * PARAMETERS);
    }
}

/* Keeps the pair of a step in the place of the oldest one, if the total bends upwards along it. */
static void remember(struct curvature *c, const struct line *line, const double *before)
{
    /* room of the search, which is over: a pair without a bend leaves the oldest one as it is */
    double *const step = line->slopes;
    double bend = 0, length = 0, change = 0;
    for (int i = 0; i < PARAMETERS; i++) {
        /* as it was rounded */
        step[i] = line->v->rate[i] != 0 ? (double)line->v->raw[i] - line->from[i] : 0;
        const double y = line->lowest[i] - before[i];
        bend += step[i] * y;
        length += step[i] * step[i];
        change += y * y;
    }
    if (!(bend > LEAST_CURVATURE * sqrt(length) * sqrt(change))) {
        return;
    }
    const int pair = c->pairs > 0 ? (c->newest + 1) % c->history : 0;
    double *const changes = c->changes + (size_t)pair * PARAMETERS;
    memcpy(c->steps + (size_t)pair * PARAMETERS, step, PARAMETERS * sizeof *step);
    for (int i = 0; i < PARAMETERS; i++) {
        changes[i] = line->lowest[i] - before[i];
    }
    c->shares[pair] = 1.0 / bend;
    c->newest = pair;
    c->pairs = c->pairs < c->history ? c->pairs + 1 : c->history;
}

/* Steps from raw variables at which the batch has this total and these slopes. */
static void descend(struct team *team, struct batch *b, struct variables *v,
                    const struct optimizer *o, const double *weights, double total,
                    const real *slopes)
{
    struct curvature *const c = o->curvature;
    double *const g = c->work;
    double *const from = g + PARAMETERS;
    double *const d = from + PARAMETERS;
    struct line line = {team, b, v, o, weights, from, d, 0, d + PARAMETERS, d + 2 * PARAMETERS,
                        c->looks};
    struct place now = {0, total + with_known(v, o, slopes, g), 0};
    /* a search may want to look twice */
    for (int n = 0; n < c->iterations && line.looks > 1; n++) {
        double steepness = 0, rate = 0;
        direction_of(c, g, d);
        line.longest = 0;
        for (int i = 0; i < PARAMETERS; i++) {
            from[i] = (double)v->raw[i];
            steepness += fabs(g[i]);
            line.longest = fmax(line.longest, fabs(d[i]));
            rate = fmax(rate, (double)v->rate[i]);
        }
        now.slope = dot(g, d);
        if (!(now.slope < -LEAST_FALL * fabs(now.value))) {
            break;
        }
        /* the first step knows no curvature: it changes the variables by no more than the rate */
        const double length = c->pairs > 0 ? rate : rate * fmin(1.0, 1.0 / steepness);
        const struct place low = search_along(&line, now, length);
        go_to(&line, low.length);
        if (low.length == 0) {
            /* a search that had all its looks has found the curvature to be wrong */
            c->pairs = line.looks > 0 ? 0 : c->pairs;
            break;
        }
        remember(c, &line, g);
        memcpy(g, line.lowest, PARAMETERS * sizeof *g);
        const double fall = now.value - low.value;
        now.value = low.value;
        if (fall <= LEAST_FALL * fabs(low.value) || low.length * line.longest <= LEAST_MOVE) {
            break;
        }
    }
}
