/* Start of a Cortex-M4F: vectors, memory and the floating-point unit, then main. */
#include "board.h"

extern uint32_t _sidata, _sdata, _edata, _sbss, _ebss, _estack;
int main(void); /* replay.c */

void reset(void)
{
    const uint32_t *from = &_sidata;
    for (uint32_t *to = &_sdata; to < &_edata;) {
        *to++ = *from++;
    }
    for (uint32_t *to = &_sbss; to < &_ebss;) {
        *to++ = 0u;
    }
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: full access to the FPU */
    __asm volatile("dsb\n isb");
    leave(main());
}

static void stop(void)
{
    say("fault\n");
    leave(70);
}

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    &_estack, (void *)reset, (void *)stop, (void *)stop, (void *)stop, (void *)stop, (void *)stop,
};
