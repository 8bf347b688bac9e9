/* Raw variables and their physical values. Of libm only what is rounded correctly: its other functions
   differ from one system to the next. */
enum { LINEAR = 0, BETWEEN = 1, ABOVE = 2, BELOW = 3 };

struct variables {
    const int32_t *kind;            /* how each number follows from its raw variable */
    const double *low;
    const double *high;
    const double *scale;
    const real *rate;               /* learning rate of each number; 0: it is held */
    real *raw;
    real *physical;
    real *first;                    /* moments of the optimiser */
    real *second;
};

/* The physical value of one raw variable. */
static double physical_of(const struct variables *v, int i)
{
    const double raw = (double)v->raw[i];
    switch (v->kind[i]) {
#if BOUNDED
    case BETWEEN: {
        /* from the nearer bound: rounding never passes it */
        const double share = (v->high[i] - v->low[i]) * double_sigmoid(-fabs(raw));
        return raw > 0.0 ? v->high[i] - share : v->low[i] + share;
    }
    case ABOVE: return v->low[i] + v->scale[i] * double_softplus(raw);
    case BELOW: return v->high[i] - v->scale[i] * double_softplus(-raw);
#endif
    default: return raw * v->scale[i];
    }
}

/* Physical values of the raw variables that move: those without bounds at once, then the others. */
void msnn_physical(struct variables *v)
{
    const real *restrict const rate = v->rate;
    const real *restrict const raws = v->raw;
    const double *restrict const scale = v->scale;
    real *restrict const physical = v->physical;
    int bounded = 0;
    for (int i = 0; i < PARAMETERS; i++) {
        bounded |= v->kind[i];
        physical[i] = rate[i] == 0 || v->kind[i] != LINEAR ? physical[i]
                                                           : (real)((double)raws[i] * scale[i]);
    }
    for (int i = 0; bounded && i < PARAMETERS; i++) {
        if (v->rate[i] != 0 && v->kind[i] != LINEAR) {
            v->physical[i] = (real)physical_of(v, i);
        }
    }
}

/* d physical / d raw of one number. */
static double slope(const struct variables *v, int i)
{
    switch (v->kind[i]) {
#if BOUNDED
    case BETWEEN: {
        const double raw = (double)v->raw[i];
        return (v->high[i] - v->low[i]) * double_sigmoid(raw) * double_sigmoid(-raw);
    }
    case ABOVE: return v->scale[i] * double_sigmoid((double)v->raw[i]);
    case BELOW: return v->scale[i] * double_sigmoid(-(double)v->raw[i]);
#endif
    default: return v->scale[i];
    }
}
