/* x: what the model remembers from step to step: how many numbers, and where each quantity
 * begins. */
#define FIR_CLOSED_LOOP_NX 5U
/* x.tape [m], t 5 */
#define FIR_CLOSED_LOOP_X_X_TAPE 0U

/* u: inputs of a step: how many numbers, and where each quantity begins. */
#define FIR_CLOSED_LOOP_NU 1U
/* F [N] */
#define FIR_CLOSED_LOOP_U_F 0U

/* y: outputs of a step: how many numbers, and where each quantity begins. */
#define FIR_CLOSED_LOOP_NY 1U
/* x_next [m] */
#define FIR_CLOSED_LOOP_Y_X_NEXT 0U
