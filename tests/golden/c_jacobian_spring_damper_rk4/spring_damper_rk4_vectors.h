/* x: what the model remembers from step to step: how many numbers, and where each quantity
 * begins. */
#define SPRING_DAMPER_RK4_NX 2U
/* x [m] */
#define SPRING_DAMPER_RK4_X_X 0U
/* v [m/s] */
#define SPRING_DAMPER_RK4_X_V 1U

/* u: inputs of a step: how many numbers, and where each quantity begins. */
#define SPRING_DAMPER_RK4_NU 1U
/* F [N] */
#define SPRING_DAMPER_RK4_U_F 0U

/* y: outputs of a step: how many numbers, and where each quantity begins. */
#define SPRING_DAMPER_RK4_NY 2U
/* position [m] */
#define SPRING_DAMPER_RK4_Y_POSITION 0U
/* spring_force [N] */
#define SPRING_DAMPER_RK4_Y_SPRING_FORCE 1U
