/* Moves the translated car on by a sample: Runge-Kutta of the fourth order, with its actuator. */

enum { STATES = 29, ANGLE = 2 };

/* `late` of the `substeps` are still steered by `before`; `push` [m/s²] holds for all. */
void drive(double *x, double before, double asked, int late, double push, double lag,
           double sample_time, int substeps, double *slope, const double *p)
{
    static const double stages[4] = {0.0, 0.5, 0.5, 1.0};
    static const double weights[4] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
    const double h = sample_time / substeps;
    double at[STATES], sum[STATES], u[2];
    for (int step = 0; step <= substeps; step++) {
        const double target = step < late ? before : asked;
        for (int i = 0; i < STATES; i++)
            sum[i] = 0.0;
        for (int stage = 0; stage < 4; stage++) {
            for (int i = 0; i < STATES; i++)
                at[i] = x[i] + (stage > 0 ? stages[stage] * h * slope[i] : 0.0);
            u[0] = (target - at[ANGLE]) / lag; /* the model keeps it within `steering.v_max` */
            u[1] = push;
            vehicle_dynamics_mb(at, u, slope, p);
            if (step == substeps)
                return; /* the slope where the sample ends */
            for (int i = 0; i < STATES; i++)
                sum[i] += weights[stage] * slope[i];
        }
        for (int i = 0; i < STATES; i++)
            x[i] += h * sum[i];
    }
}

/* One evaluation, to be compared with the Python that it was translated from. */
void slopes(double *x, double *u, double *slope, const double *p)
{
    vehicle_dynamics_mb(x, u, slope, p);
}
