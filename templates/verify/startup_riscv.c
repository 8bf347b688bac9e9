/* Starts a RISC-V core in machine mode: stack, floating point, memory, main. */
#include <stdint.h>

extern uint32_t data_start, data_end, data_load, bss_start, bss_end;

int main(void);
void start_in_c(void);
void start(void);

__attribute__((section(".vectors"), naked, used)) void start(void)
{
    __asm volatile(
        ".option push\n.option norelax\nla gp, __global_pointer$\n.option pop\n"
        "la sp, stack_top\n"
#if defined(__riscv_flen)
        "li t0, 0x2000\ncsrs mstatus, t0\n" /* FS = initial */
        "csrw fcsr, zero\n"
#endif
        "j start_in_c");
}

void start_in_c(void)
{
    const uint32_t *from = &data_load;
    for (uint32_t *to = &data_start; to < &data_end; to++) {
        *to = *from++;
    }
    for (uint32_t *to = &bss_start; to < &bss_end; to++) {
        *to = 0U;
    }
    (void)main();
    for (;;) {
    }
}
