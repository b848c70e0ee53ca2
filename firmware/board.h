/* A Cortex-M4F under QEMU: words and files by semihosting, time from SysTick, the depth of the stack. */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

void say(const char *text);
void say_number(const char *name, uint64_t number);
void leave(int status);

/* Files of the computer that emulates: a handle, below 0 where there is none; bytes that were read or written. */
enum { FILE_READ = 1, FILE_WRITE = 5 };
int file_open(const char *name, int how);
uint32_t file_read(int file, void *to, uint32_t bytes);
uint32_t file_write(int file, const void *from, uint32_t bytes);

/* Ticks of SysTick; with `-icount shift=6` an instruction takes 64 ns. */
void clock_start(void);
uint32_t clock_now(void);

/* Fill what is free between the variables and the stack; where the stack of the caller ends, and where its paint does. */
void stack_paint(void);
uint32_t stack_here(void);
uint32_t stack_deepest(void);

#endif
