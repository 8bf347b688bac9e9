/* Trained values of the model `joint_arm`. Made by msnn; do not edit. */
#include "joint_arm.h"

#include <math.h>

const JOINT_ARM_PLACED joint_arm_params_t joint_arm_params_default = {
    /* own.weight */
    {
        0.1f, -0.2f, 0.15f, 0.7f, 0.05f, 0.02f, -0.1f, 0.8f, -0.05f, 0.1f, 0.2f, 0.6f
    },
    /* coupling */
    {
        0.1f, 0.02f, 0.0f, 0.02f, 0.12f, -0.03f, 0.01f, -0.02f, 0.09f
    },
    /* shape */
    {
        0.05f, -0.02f, 0.04f, 0.01f, 0.03f, -0.02f
    }
};
