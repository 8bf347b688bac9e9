/* The optimisers that take a step of known length along each slope. */
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
#if KNOWN
        if (o->known != NULL) {
            /* so much of a lasting slope is in the steps: 1 + β + β² + … */
            const double kept = 1.0 - o->beta1;
            const double share = kept > 0 ? 1.0 / kept : 1.0;
            double step[PARAMETERS + 1];
            for (int i = 0; i < PARAMETERS; i++) {
                step[i] = (double)rate[i] * share;
            }
            approach(v, o->known, step);
        }
#endif
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
#if KNOWN
    if (o->known != NULL) {
        double step[PARAMETERS + 1];
        for (int i = 0; i < PARAMETERS; i++) {
            const real size = square_root(second[i]) * size_scale + epsilon;
            step[i] = (double)rate[i] / (double)size;
        }
        approach(v, o->known, step);
    }
#endif
}
