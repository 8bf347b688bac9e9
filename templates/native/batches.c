/* Batches and optimisers: whole epochs run here, so that no call is paid for each batch. */
enum { LINEAR = 0, BETWEEN = 1, ABOVE = 2, BELOW = 3 };
enum { ADAM = 0, ADAMW = 1, SGD = 2 };

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

struct optimizer {
    int32_t method;
    int32_t missing;                /* targets may be missing: count before scaling */
    double beta1;
    double beta2;
    double epsilon;
    double decay;
    double clip;                    /* 0: none */
    int64_t steps;                  /* taken so far */
};

static double softplus(double x) { return fmax(x, 0.0) + log1p(exp(-fabs(x))); }

static double sigmoid(double x)
{
    const double small = exp(-fabs(x));
    return x >= 0.0 ? 1.0 / (1.0 + small) : small / (1.0 + small);
}

/* Physical values of the raw variables that move. */
void msnn_physical(struct variables *v)
{
    for (int i = 0; i < PARAMETERS; i++) {
        const double raw = (double)v->raw[i];
        if (v->rate[i] == 0) {
            continue;
        }
        switch (v->kind[i]) {
        case BETWEEN: v->physical[i] = (real)(v->low[i] + (v->high[i] - v->low[i]) * sigmoid(raw)); break;
        case ABOVE: v->physical[i] = (real)(v->low[i] + v->scale[i] * softplus(raw)); break;
        case BELOW: v->physical[i] = (real)(v->high[i] - v->scale[i] * softplus(-raw)); break;
        default: v->physical[i] = (real)(raw * v->scale[i]); break;
        }
    }
}

/* d physical / d raw of one number. */
static double slope(const struct variables *v, int i)
{
    const double raw = (double)v->raw[i];
    switch (v->kind[i]) {
    case BETWEEN: return (v->high[i] - v->low[i]) * sigmoid(raw) * sigmoid(-raw);
    case ABOVE: return v->scale[i] * sigmoid(raw);
    case BELOW: return v->scale[i] * sigmoid(-raw);
    default: return v->scale[i];
    }
}

/* Groups whose gradients are added lane by lane before the lanes are: fixed, whatever the batch. */
#define GROUPS_ADDED 4

/* Sums and counts of every loss over the groups, and the gradient in physical values if wanted. */
int msnn_losses(const struct problem *p, const struct group *groups, int64_t n, const real *physical,
                const double *weights, int missing, real *work, real *gradient, double *sums,
                double *counts)
{
    lanes theta[PARAMETERS + 1];
    lanes scale[LOSSES + 1];
    lanes collected[PARAMETERS + 1];
    for (int i = 0; i < PARAMETERS; i++) {
        theta[i] = splat(physical[i]);
    }
    memset(sums, 0, LOSSES * sizeof *sums);
    memset(counts, 0, LOSSES * sizeof *counts);
    if (gradient == NULL || missing || HAS_ROOT) {
        for (int64_t k = 0; k < n; k++) {
            run_group(p, &groups[k], theta, scale, (lanes *)work, NULL, sums, counts);
        }
        if (gradient == NULL) {
            return 0;
        }
    } else {
        for (int64_t k = 0; k < n; k++) {
            double used = 0;
            for (int i = 0; i < LANES; i++) {
                used += groups[k].used[i] ? 1.0 : 0.0;
            }
            for (int l = 0; l < LOSSES; l++) {
                counts[l] += used * fmax((double)(groups[k].steps - p->skip), 0.0) * ELEMENTS[l];
            }
        }
    }
    for (int l = 0; l < LOSSES; l++) {
        const double root = IS_ROOT[l] ? sqrt(sums[l] / fmax(counts[l], 1.0)) : 0.5;
        const double share = counts[l] > 0 && root > 0 ? weights[l] / (2.0 * root * counts[l]) : 0.0;
        scale[l] = splat((real)share);
    }
    memset(gradient, 0, PARAMETERS * sizeof *gradient);
    memset(sums, 0, LOSSES * sizeof *sums);
    for (int64_t k = 0; k < n; k += GROUPS_ADDED) {
        memset(collected, 0, sizeof collected);
        for (int64_t m = k; m < n && m < k + GROUPS_ADDED; m++) {
            run_group(p, &groups[m], theta, scale, (lanes *)work, collected, sums, NULL);
        }
        for (int i = 0; i < PARAMETERS; i++) {
            gradient[i] += sum_lanes(collected[i]);
        }
    }
    return 0;
}

/* One step of the optimiser along the gradient in raw variables; numbers of rate 0 stay. */
static void move(struct variables *v, struct optimizer *o, const real *restrict gradient)
{
    o->steps += 1;
    const real *restrict const rate = v->rate;
    real *restrict const raw = v->raw;
    real *restrict const first = v->first;
    real *restrict const second = v->second;
    /* 1 − β is rounded once: in float32, 1 − 0.999f is off by 1e-5 */
    const real b1 = (real)o->beta1;
    const real b2 = (real)o->beta2;
    const real c1 = (real)(1.0 - o->beta1);
    const real c2 = (real)(1.0 - o->beta2);
    const real decay = (real)o->decay;
    if (o->method == SGD) {
        for (int i = 0; i < PARAMETERS; i++) {
            const real g = gradient[i] + decay * raw[i];
            first[i] = o->steps == 1 ? g : b1 * first[i] + g;
            raw[i] -= rate[i] * first[i];
        }
        return;
    }
    const real shrunk = o->method == ADAMW ? decay : 0;
    const real added = o->method == ADAMW ? 0 : decay;
    const real rate_scale = (real)(1.0 / (1.0 - pow(o->beta1, (double)o->steps)));
    const real size_scale = (real)(1.0 / sqrt(1.0 - pow(o->beta2, (double)o->steps)));
    const real epsilon = (real)o->epsilon;
    for (int i = 0; i < PARAMETERS; i++) {
        const real from = raw[i] - rate[i] * shrunk * raw[i];
        const real g = gradient[i] + added * from;
        first[i] += c1 * (g - first[i]);
        second[i] = b2 * second[i] + c2 * g * g;
        const real size = square_root(second[i]) * size_scale + epsilon;
        raw[i] = from - rate[i] * rate_scale * (first[i] / size);
    }
}

/* Batches of groups in order; returns how many were finite, all if none stopped it. */
int64_t msnn_train(const struct problem *p, const struct group *groups, const int64_t *bounds,
                   int64_t batches, struct variables *v, struct optimizer *o, const double *weights,
                   real *work, double *sums, double *counts)
{
    for (int64_t b = 0; b < batches; b++) {
        real gradient[PARAMETERS + 1];
        double batch_sums[LOSSES + 1];
        double batch_counts[LOSSES + 1];
        const int64_t n = bounds[b + 1] - bounds[b];
        msnn_losses(p, groups + bounds[b], n, v->physical, weights, o->missing, work, gradient,
                    batch_sums, batch_counts);
        double total = 0;
        for (int l = 0; l < LOSSES; l++) {
            const double mean = batch_sums[l] / fmax(batch_counts[l], 1.0);
            total += weights[l] * (IS_ROOT[l] ? sqrt(mean) : mean);
        }
        double squares = 0;
        for (int i = 0; i < PARAMETERS; i++) {
            gradient[i] *= v->rate[i] == 0 ? 0 : (real)slope(v, i);
            squares += v->rate[i] == 0 ? 0.0 : (double)gradient[i] * (double)gradient[i];
        }
        if (!isfinite(total) || !isfinite(squares)) {
            return b;
        }
        for (int l = 0; l < LOSSES; l++) {
            sums[l] += batch_sums[l];
            counts[l] += batch_counts[l];
        }
        if (o->clip > 0 && sqrt(squares) > o->clip) {
            const double factor = o->clip / (sqrt(squares) + 1e-6);
            for (int i = 0; i < PARAMETERS; i++) {
                gradient[i] *= (real)factor;
            }
        }
        move(v, o, gradient);
        msnn_physical(v);
    }
    return batches;
}
