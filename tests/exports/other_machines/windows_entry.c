/*
 * Where Windows begins a program: MinGW's C library would have this, and takes a minute to compile.
 */

#include <corecrt_startup.h>
#include <stdlib.h>

int main(int argc, char **argv);

/* compilers for MinGW let main call it */
void __main(void);
void __main(void) {}

void mainCRTStartup(void);
void mainCRTStartup(void)
{
    _configure_narrow_argv(_crt_argv_unexpanded_arguments);
    exit(main(*__p___argc(), *__p___argv()));
}
