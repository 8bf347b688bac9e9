/* Trained values of the model `fir_closed_loop`. Made by msnn; do not edit. */
#include "fir_closed_loop.h"

#include <math.h>

const FIR_CLOSED_LOOP_PLACED fir_closed_loop_params_t fir_closed_loop_params_default = {
    /* h.weight */
    {
        0.031f, -0.22f, 0.17f, -0.41f, 1.13f
    },
    /* g.weight */
    {
        0.087f
    }
};
