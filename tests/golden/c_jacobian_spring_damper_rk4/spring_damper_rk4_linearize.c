/* Computes the slopes of one step in its states and inputs. */
spring_damper_rk4_status_t spring_damper_rk4_linearize(
    const spring_damper_rk4_state_t *s,
    const SPRING_DAMPER_RK4_PLACED spring_damper_rk4_params_t *p,
    const spring_damper_rk4_in_t *u,
    spring_damper_rk4_jacobian_t *jac)
{
    spring_damper_rk4_status_t status = SPRING_DAMPER_RK4_OK;
    if (s->ready != 4U) {
        status |= SPRING_DAMPER_RK4_STATUS_UNINITIALISED;
    }
    /* inputs */
    if (!(fabsf(u->F) <= 10.0f)) {
        spring_damper_rk4_flagged(u->F, -10.0f, 10.0f, &status);
    }
    const spring_damper_rk4_real part = 0.00041666668f / p->mass;
    const spring_damper_rk4_real part_2 = -part;
    const spring_damper_rk4_real part_3 = part_2 * p->stiffness;
    const spring_damper_rk4_real part_4 = (part_2 * p->damping) + 0.016666668f;
    const spring_damper_rk4_real part_5 = (part_4 * 0.025f) / p->mass;
    const spring_damper_rk4_real part_6 = -part_5;
    const spring_damper_rk4_real part_7 = part_6 * p->stiffness;
    const spring_damper_rk4_real part_8 = ((part_3 * 0.025f) + 0.016666668f)
        + (part_6 * p->damping);
    const spring_damper_rk4_real part_9 = (part_8 * 0.025f) / p->mass;
    const spring_damper_rk4_real part_10 = -part_9;
    const spring_damper_rk4_real part_11 = 0.008333334f / p->mass;
    const spring_damper_rk4_real part_12 = -part_11;
    const spring_damper_rk4_real part_13 = part_12 * p->stiffness;
    const spring_damper_rk4_real part_14 = part_12 * p->damping;
    const spring_damper_rk4_real part_15 = (0.016666668f + (part_14 * 0.05f)) / p->mass;
    const spring_damper_rk4_real part_16 = -part_15;
    const spring_damper_rk4_real part_17 = part_16 * p->stiffness;
    const spring_damper_rk4_real part_18 = (part_13 * 0.05f) + (part_16 * p->damping);
    const spring_damper_rk4_real part_19 = (0.016666668f + (part_18 * 0.025f)) / p->mass;
    const spring_damper_rk4_real part_20 = -part_19;
    const spring_damper_rk4_real part_21 = part_20 * p->stiffness;
    const spring_damper_rk4_real part_22 = (part_17 * 0.025f) + (part_20 * p->damping);
    const spring_damper_rk4_real part_23 = (0.008333334f + (part_22 * 0.025f)) / p->mass;
    const spring_damper_rk4_real part_24 = -part_23;
    /* A = d x of the next step / d x: 2 x 2, row after row */
    /* . is always 0, = always the same number, p made of parameters only, * computed */
    /* p p x .. v */
    /* d next x / d x [1] */
    jac->A[0U] = ((1.0f + part_3) + part_7) + (part_10 * p->stiffness);
    /* d next x / d v [s] */
    jac->A[1U] = (((0.016666668f + part_4) + (part_7 * 0.025f)) + part_8) + (part_10 * p->damping);
    /* d next v / d x [1/s] */
    jac->A[2U] = ((part_13 + part_17) + part_21) + (part_24 * p->stiffness);
    /* d next v / d v [1] */
    jac->A[3U] = ((((1.0f + part_14) + part_18) + (part_21 * 0.025f)) + part_22)
        + (part_24 * p->damping);
    /* B = d x of the next step / d u: 2 x 1, row after row */
    /* . is always 0, = always the same number, p made of parameters only, * computed */
    /* p x .. v */
    /* d next x / d F [m/N] */
    jac->B[0U] = (part + part_5) + part_9;
    /* d next v / d F [m/s/N] */
    jac->B[1U] = ((part_11 + part_15) + part_19) + part_23;
    /* C = d y / d x: 2 x 2, row after row */
    /* . is always 0, = always the same number, p made of parameters only, * computed */
    /* = . position */
    /* p . spring_force */
    jac->C[0U] = 1.0f;
    jac->C[1U] = 0.0f;
    jac->C[3U] = 0.0f;
    /* d spring_force / d x [N/m] */
    jac->C[2U] = p->stiffness;
    /* D = d y / d u: 2 x 1, row after row */
    /* . is always 0, = always the same number, p made of parameters only, * computed */
    /* . position .. spring_force */
    jac->D[0U] = 0.0f;
    jac->D[1U] = 0.0f;
    return status;
}

/* Copies all that is remembered into a vector x. */
void spring_damper_rk4_get_state(const spring_damper_rk4_state_t *s, spring_damper_rk4_real *v)
{
    v[SPRING_DAMPER_RK4_X_X] = s->x;
    v[SPRING_DAMPER_RK4_X_V] = s->v;
}

/* Replaces all that is remembered by a vector x, as a filter that corrects it does; init or
 * reset come before. */
void spring_damper_rk4_set_state(spring_damper_rk4_state_t *s, const spring_damper_rk4_real *v)
{
    s->x = v[SPRING_DAMPER_RK4_X_X];
    s->v = v[SPRING_DAMPER_RK4_X_V];
    s->ready = s->ready & 4U;
}

/* Copies inputs of a step into a vector u. */
void spring_damper_rk4_get_inputs(const spring_damper_rk4_in_t *u, spring_damper_rk4_real *v)
{
    v[SPRING_DAMPER_RK4_U_F] = u->F;
}

/* Copies outputs of a step into a vector y. */
void spring_damper_rk4_get_outputs(const spring_damper_rk4_out_t *y, spring_damper_rk4_real *v)
{
    v[SPRING_DAMPER_RK4_Y_POSITION] = y->position;
    v[SPRING_DAMPER_RK4_Y_SPRING_FORCE] = y->spring_force;
}
