/* The weighted total of a batch and its slopes in raw variables, as optimisers ask for them. */
enum { ADAM = 0, ADAMW = 1, SGD = 2 };

struct optimizer {
    int32_t method;
    int32_t missing;                /* targets may be missing: count before scaling */
    double beta1;
    double beta2;
    double epsilon;
    double decay;
    double clip;                    /* 0: none */
    int64_t steps;                  /* taken so far */
    double first_decay;             /* powers of β by which Adam corrects its moments: products, */
    double second_decay;            /* the same wherever an epoch is divided into calls */
    int64_t left_out;               /* batches without a step: their slopes are infinite */
    const struct known *known;      /* NULL: nothing */
    struct curvature *curvature;    /* of L-BFGS alone: lbfgs.c */
};

enum { NOT_FINITE, TOO_STEEP, FINITE };

/* What slopes with this sum of squares are multiplied by so that they are no longer than `clip`. */
static double clip_factor(const struct optimizer *o, double squares)
{
    const double length = sqrt(squares);
    return o->clip > 0 && length > o->clip ? o->clip / (length + 1e-6) : 1.0;
}

/* Whether total and slopes of the model at the present variables are numbers, and the slopes, clipped,
   in `all`. Not so where a rank is lost. Numbers of rate 0 have no slope. */
static int raw_slopes(struct team *team, struct batch *b, const struct variables *v,
                      const struct optimizer *o, const double *weights, struct totals *all,
                      double *total)
{
    real *const gradient = all->slopes;
    if (!batch_losses(team, b, v->physical, weights, o->missing, 1, all)) {
        return NOT_FINITE;
    }
    *total = 0;
    for (int l = 0; l < LOSSES; l++) {
        const double mean = mean_of(all->sums[l], all->counts[l]);
        *total += weights[l] * (IS_ROOT[l] ? sqrt(mean) : mean);
    }
    double squares = 0;
    for (int i = 0; i < PARAMETERS; i++) {
        /* no product: 0 times an infinite slope is NaN */
        gradient[i] = v->rate[i] == 0 ? 0 : gradient[i] * (real)slope(v, i);
        squares += (double)gradient[i] * (double)gradient[i];
    }
    const int is_steep = INFINITE_SLOPES && !(squares <= LARGEST_SLOPE * LARGEST_SLOPE);
    if (!isfinite(*total) || !(is_steep || isfinite(squares))) {
        return NOT_FINITE;
    }
    if (is_steep) {
        return TOO_STEEP;
    }
#if !LBFGS
    /* its line search clips these with the slopes of what is known */
    const double factor = clip_factor(o, squares);
    if (factor < 1.0) {
        for (int i = 0; i < PARAMETERS; i++) {
            gradient[i] *= (real)factor;
        }
    }
#endif
    return FINITE;
}
