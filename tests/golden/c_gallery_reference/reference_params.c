/* Trained values of the model `reference`. Made by msnn; do not edit. */
#include "reference.h"

#include <math.h>

const REFERENCE_PLACED reference_params_t reference_params_default = {
    /* command.weight */
    {
        0.04f, 0.04f, 0.04f, 0.04f, 0.04f, 0.04f, 0.04f, 0.04f, 0.04f, 0.04f, 0.04f, 0.04f,
        0.04f, 0.04f, 0.04f, 0.04f, 0.04f, 0.04f, 0.04f, 0.04f, 0.04f, 0.04f, 0.04f, 0.04f,
        0.04f
    },
    /* gain.weight */
    {
        0.6f, 0.6f, 0.6f, 0.6f, 0.6f, 0.6f, 0.6f
    },
    /* gain.bias */
    {
        0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f
    },
    /* p0 */
    -2.0f,
    /* p1 */
    0.08f,
    /* p2 */
    0.05f
};
