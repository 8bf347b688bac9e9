/* Computes the slopes of one step in its states and inputs. */
fir_closed_loop_status_t fir_closed_loop_linearize(
    const fir_closed_loop_state_t *s,
    const FIR_CLOSED_LOOP_PLACED fir_closed_loop_params_t *p,
    const fir_closed_loop_in_t *u,
    fir_closed_loop_jacobian_t *jac)
{
    fir_closed_loop_status_t status = FIR_CLOSED_LOOP_OK;
    if (s->ready != 4U) {
        status |= FIR_CLOSED_LOOP_STATUS_UNINITIALISED;
    }
    /* inputs */
    if (!(fabsf(u->F) <= 10.0f)) {
        fir_closed_loop_flagged(u->F, -10.0f, 10.0f, &status);
    }
    /* A = d x of the next step / d x: 5 x 5, row after row */
    /* . is always 0, = always the same number, p made of parameters only, * computed */
    /* .=... x.tape[0] */
    /* ..=.. x.tape[1] */
    /* ...=. x.tape[2] */
    /* ....= x.tape[3] */
    /* ppppp x.tape[4] */
    for (uint32_t i = 0U; i < 25U; i++) {
        jac->A[i] = 0.0f;
    }
    jac->A[1U] = 1.0f;
    jac->A[7U] = 1.0f;
    jac->A[13U] = 1.0f;
    jac->A[19U] = 1.0f;
    /* d next x.tape[4] / d x.tape[0] .. x.tape[4] [1] */
    for (uint32_t i = 0U; i < 5U; i++) {
        jac->A[i + 20U] = p->h_weight[i];
    }
    /* B = d x of the next step / d u: 5 x 1, row after row */
    /* . is always 0, = always the same number, p made of parameters only, * computed */
    /* . x.tape[0] .. x.tape[3] */
    /* p x.tape[4] */
    jac->B[0U] = 0.0f;
    jac->B[1U] = 0.0f;
    jac->B[2U] = 0.0f;
    jac->B[3U] = 0.0f;
    /* d next x.tape[4] / d F [m/N] */
    jac->B[4U] = p->g_weight[0U];
    /* C = d y / d x: 1 x 5, row after row */
    /* . is always 0, = always the same number, p made of parameters only, * computed */
    /* ppppp x_next */
    /* d x_next / d x.tape[0] .. x.tape[4] [1] */
    for (uint32_t i = 0U; i < 5U; i++) {
        jac->C[i] = p->h_weight[i];
    }
    /* D = d y / d u: 1 x 1, row after row */
    /* . is always 0, = always the same number, p made of parameters only, * computed */
    /* p x_next */
    /* d x_next / d F [m/N] */
    jac->D[0U] = p->g_weight[0U];
    return status;
}

/* Copies all that is remembered into a vector x. */
void fir_closed_loop_get_state(const fir_closed_loop_state_t *s, fir_closed_loop_real *v)
{
    for (uint32_t i = 0U; i < 5U; i++) {
        v[FIR_CLOSED_LOOP_X_X_TAPE + i] = s->x_tape[i];
    }
}

/* Replaces all that is remembered by a vector x, as a filter that corrects it does; init or
 * reset come before. */
void fir_closed_loop_set_state(fir_closed_loop_state_t *s, const fir_closed_loop_real *v)
{
    for (uint32_t i = 0U; i < 5U; i++) {
        s->x_tape[i] = v[FIR_CLOSED_LOOP_X_X_TAPE + i];
    }
    s->ready = s->ready & 4U;
}

/* Copies inputs of a step into a vector u. */
void fir_closed_loop_get_inputs(const fir_closed_loop_in_t *u, fir_closed_loop_real *v)
{
    v[FIR_CLOSED_LOOP_U_F] = u->F;
}

/* Copies outputs of a step into a vector y. */
void fir_closed_loop_get_outputs(const fir_closed_loop_out_t *y, fir_closed_loop_real *v)
{
    v[FIR_CLOSED_LOOP_Y_X_NEXT] = y->x_next;
}
