/* Trained values of the model `spring_damper_rk4`. Made by msnn; do not edit. */
#include "spring_damper_rk4.h"

#include <math.h>

const SPRING_DAMPER_RK4_PLACED spring_damper_rk4_params_t spring_damper_rk4_params_default = {
    /* mass */
    1.7f,
    /* damping */
    0.8f,
    /* stiffness */
    12.0f,
    /* v_start */
    0.1f
};
