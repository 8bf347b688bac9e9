/* What is known of raw variables beside the slopes of the losses: the proximal step of
   backends/known_terms.py, where the formulas stand, operation by operation. */
enum { NEWTON_STEPS = 30 };

struct known {
    const double *mean;             /* of the prior of each number */
    const double *std;              /* 0: none */
    const double *magnitude;        /* weight of |raw| of each number */
    const int32_t *numbers;         /* of the slices, one slice after the other */
    const int64_t *bounds;          /* where each slice begins and the last one ends */
    const double *norms;            /* weight of the norm of each slice */
    int64_t slices;
    double spread;                  /* mean squared residual of the epoch before, by values */
};

/* z with z(1 + reach/|z|) = the raw variables of a slice; 0 where there is none. */
static void shrink(real *restrict raw, const double *restrict step, const int32_t *restrict number,
                   int64_t count, double weight)
{
    double outside = 0, squares = 0, farthest = 0;
    for (int64_t k = 0; k < count; k++) {
        const double reach = step[number[k]] * weight;
        const double value = (double)raw[number[k]];
        if (!(reach > 0)) {
            return;
        }
        const double part = value / reach;
        outside += part * part;
        squares += value * value;
        farthest = reach > farthest ? reach : farthest;
    }
    if (outside <= 1.0) {
        for (int64_t k = 0; k < count; k++) {
            raw[number[k]] = 0;
        }
        return;
    }
    double radius = sqrt(squares) - farthest;
    radius = radius > 0 ? radius : 0;
    for (int i = 0; i < NEWTON_STEPS; i++) {
        double found = 0, steep = 0;
        for (int64_t k = 0; k < count; k++) {
            const double far = radius + step[number[k]] * weight;
            const double part = (double)raw[number[k]] / far;
            found += part * part;
            steep += part * part / far;
        }
        const double following = radius + (sqrt(found) - 1.0) * found / steep;
        if (!(following > radius)) {
            break;
        }
        radius = following;
    }
    for (int64_t k = 0; k < count; k++) {
        const double far = radius + step[number[k]] * weight;
        raw[number[k]] = (real)((double)raw[number[k]] * (radius / far));
    }
}

/* The proximal step after one of the lengths `step` along the slope, which are lost. */
static void approach(struct variables *v, const struct known *known, double *restrict step)
{
    real *restrict const raw = v->raw;
    for (int i = 0; i < PARAMETERS; i++) {
        double limit = step[i] * known->magnitude[i];
        if (step[i] > 0 && known->std[i] > 0 && known->spread > 0) {
            const double steep = slope(v, i);
            const double variance = known->std[i] * known->std[i];
            const double pull = 2.0 * known->spread * step[i] * steep;
            const double width = variance + pull * steep;
            double move = pull * (physical_of(v, i) - known->mean[i]) / width;
            if (v->kind[i] != LINEAR) {
                move = move > 1.0 ? 1.0 : move < -1.0 ? -1.0 : move;
            }
            raw[i] = (real)((double)raw[i] - move);
            step[i] *= variance / width;
            limit = step[i] * known->magnitude[i];
        }
        if (limit > 0) {
            const double value = (double)raw[i];
            raw[i] = (real)(value > limit ? value - limit : value < -limit ? value + limit : 0.0);
        }
    }
    for (int64_t s = 0; s < known->slices; s++) {
        const int64_t begin = known->bounds[s];
        shrink(raw, step, known->numbers + begin, known->bounds[s + 1] - begin, known->norms[s]);
    }
}
