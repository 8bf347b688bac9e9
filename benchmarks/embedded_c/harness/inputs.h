/* Inputs of every contender: levels held for 64 steps with noise, so that all speeds occur. */
static float drawn(int k)
{
    static uint32_t state = 12345U;
    static float level;
    state = (state * 1664525U) + 1013904223U;
    const float random = ((float)(state >> 8U) * 0x1p-23f) - 1.0f;
    if ((k % 64) == 0) {
        level = 18.0f * random;
    }
    return level + (2.0f * random);
}
