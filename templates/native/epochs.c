/* The order of an epoch and the groups of its batches: what takes longer in Python than small models
   take to train. */

/* The numbers 0 … count−1 as `shuffled` of msnn/training/plans/epochs.py has them. */
void msnn_shuffled(uint64_t key, int64_t count, int64_t *restrict order)
{
    for (int64_t i = 0; i < count; i++) {
        uint64_t bits = key + (uint64_t)(i + 1) * UINT64_C(0x9e3779b97f4a7c15);
        bits = (bits ^ (bits >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
        bits = (bits ^ (bits >> 27)) * UINT64_C(0x94d049bb133111eb);
        bits ^= bits >> 31;
        const uint64_t j = ((bits >> 32) * (uint64_t)(i + 1)) >> 32;
        order[i] = order[j];
        order[j] = i;
    }
}

/* Groups of batches of the members, rollouts of one length, as `lane_groups` of backends/native has
   them. */
void msnn_groups(const int64_t *restrict starts, const int64_t *restrict members, int64_t count,
                 int64_t batch, int64_t steps, struct group *restrict groups)
{
    for (int64_t begin = 0; begin < count; begin += batch) {
        const int64_t end = begin + batch < count ? begin + batch : count;
        for (int64_t first = begin; first < end; first += GROUP, groups++) {
            const int64_t own = end - first < GROUP ? end - first : GROUP;
            groups->steps = steps;
            for (int64_t l = 0; l < own; l++) {
                groups->start[l] = starts[members[first + l]];
                groups->used[l] = -1;
            }
            for (int64_t l = own; l < GROUP; l++) {
                groups->start[l] = starts[members[end - 1]];
                groups->used[l] = 0;
            }
        }
    }
}
