/* Raw variables, their physical values, and the optimisers that move them. Of libm only what is
   rounded correctly: its other functions differ from one system to the next. */
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
    double first_decay;             /* powers of β by which Adam corrects its moments: products, */
    double second_decay;            /* the same wherever an epoch is divided into calls */
    int64_t left_out;               /* batches without a step: their slopes are infinite */
};

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
        const double raw = (double)v->raw[i];
        if (v->rate[i] == 0) {
            continue;
        }
        switch (v->kind[i]) {
        case BETWEEN: v->physical[i] = (real)(v->low[i] + (v->high[i] - v->low[i]) * double_sigmoid(raw)); break;
        case ABOVE: v->physical[i] = (real)(v->low[i] + v->scale[i] * double_softplus(raw)); break;
        case BELOW: v->physical[i] = (real)(v->high[i] - v->scale[i] * double_softplus(-raw)); break;
        default: break;
        }
    }
}

/* d physical / d raw of one number. */
static double slope(const struct variables *v, int i)
{
    const double raw = (double)v->raw[i];
    switch (v->kind[i]) {
    case BETWEEN: return (v->high[i] - v->low[i]) * double_sigmoid(raw) * double_sigmoid(-raw);
    case ABOVE: return v->scale[i] * double_sigmoid(raw);
    case BELOW: return v->scale[i] * double_sigmoid(-raw);
    default: return v->scale[i];
    }
}

/* The next power of β; 0 once 1 less it is 1: subnormal numbers would take their time. */
static double next_power(double power, double beta)
{
    return power < 1e-20 ? 0.0 : power * beta;
}

/* One step of the optimiser along the gradient in raw variables; numbers of rate 0 stay. */
static void move(struct variables *v, struct optimizer *o, const real *restrict gradient)
{
    o->steps += 1;
    o->first_decay = next_power(o->first_decay, o->beta1);
    o->second_decay = next_power(o->second_decay, o->beta2);
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
    const real rate_scale = (real)(1.0 / (1.0 - o->first_decay));
    const real size_scale = (real)(1.0 / sqrt(1.0 - o->second_decay));
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
