/* A Cortex-M4F under QEMU: words out by semihosting, time from SysTick, the depth of the stack. */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

void say(const char *text);
void say_number(const char *name, uint32_t number);
void leave(int status);

/* Ticks of SysTick; with `-icount shift=6` an instruction takes 64 ns. */
void clock_start(void);
uint32_t clock_now(void);

/* Fill what is free between the variables and the stack; then how many bytes of it were never touched. */
void stack_paint(void);
uint32_t stack_left(void);

#endif
