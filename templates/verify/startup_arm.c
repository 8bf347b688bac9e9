/* Starts a Cortex-M: vector table, memory, floating point, main. */
#include <stdint.h>

extern uint32_t stack_top;
extern uint32_t data_start, data_end, data_load, bss_start, bss_end;

int main(void);
void start(void);

static void trap(void)
{
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static void (*const vectors[16])(void) = {
    (void (*)(void))(&stack_top), start, trap, trap, trap, trap, trap,
};

void start(void)
{
#if defined(__ARM_FP)
    /* coprocessors 10 and 11, then a barrier */
    *(volatile uint32_t *)0xE000ED88U |= 0xFU << 20U;
    __asm volatile("dsb\nisb" ::: "memory");
#endif
    const uint32_t *from = &data_load;
    for (uint32_t *to = &data_start; to < &data_end; to++) {
        *to = *from++;
    }
    for (uint32_t *to = &bss_start; to < &bss_end; to++) {
        *to = 0U;
    }
    (void)main();
    trap();
}
