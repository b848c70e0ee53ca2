/* The emulated board: words and files by semihosting, SysTick, the paint of the stack. */
#include "board.h"

extern uint32_t _ebss;

static int semihosting(int operation, const void *argument)
{
    register int r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = argument;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

void say(const char *text)
{
    semihosting(0x04, text);
}

void say_number(const char *name, uint64_t number)
{
    char digits[24];
    char *at = digits + sizeof digits - 1;
    *at = '\0';
    do {
        *--at = (char)('0' + number % 10u);
        number /= 10u;
    } while (number);
    say(name);
    say(" ");
    say(at);
    say("\n");
}

int file_open(const char *name, int how)
{
    uint32_t length = 0;
    while (name[length]) {
        ++length;
    }
    const uint32_t block[3] = {(uint32_t)name, (uint32_t)how, length};
    return semihosting(0x01, block);
}

uint32_t file_read(int file, void *to, uint32_t bytes)
{
    const uint32_t block[3] = {(uint32_t)file, (uint32_t)to, bytes};
    return bytes - (uint32_t)semihosting(0x06, block); /* it says how many are missing */
}

uint32_t file_write(int file, const void *from, uint32_t bytes)
{
    const uint32_t block[3] = {(uint32_t)file, (uint32_t)from, bytes};
    return bytes - (uint32_t)semihosting(0x05, block);
}

void leave(int status)
{
    const uint32_t block[2] = {0x20026u, (uint32_t)status};
    semihosting(0x20, block);
    for (;;) {
    }
}

void clock_start(void)
{
    *(volatile uint32_t *)0xE000E014u = 0xFFFFFFu; /* SysTick: counts down from here */
    *(volatile uint32_t *)0xE000E018u = 0u;
    *(volatile uint32_t *)0xE000E010u = 5u;
}

uint32_t clock_now(void)
{
    return 0xFFFFFFu - *(volatile uint32_t *)0xE000E018u;
}

void stack_paint(void)
{
    uint32_t *here;
    __asm volatile("mov %0, sp" : "=r"(here));
    for (uint32_t *at = &_ebss; at < here - 4; ++at) {
        *(volatile uint32_t *)at = 0xA5A5A5A5u;
    }
}

uint32_t stack_here(void)
{
    uint32_t here;
    __asm volatile("mov %0, sp" : "=r"(here));
    return here;
}

uint32_t stack_deepest(void)
{
    const uint32_t *at = &_ebss;
    while (*at == 0xA5A5A5A5u) {
        ++at;
    }
    return (uint32_t)at;
}
