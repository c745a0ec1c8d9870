/* Preloaded into user-mode Linux: sets a process's registers on processors with AMX.
 *
 * User-mode Linux before 6.13 keeps 2,696 bytes of a process's floating-point registers. Where the processor has
 * AMX the whole set takes 11,008, and Linux refuses to set a part of it (EFAULT). This ptrace reads the whole set,
 * replaces the part that user-mode Linux has, and sets it. The rest are the AMX tiles, which no process in the
 * guest uses: Linux gives them only to a process that asks (arch_prctl), and the guest has no such call. */

#define _GNU_SOURCE
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

#define NT_X86_XSTATE 0x202
#define LARGEST 65536

static char whole[LARGEST];

long ptrace(enum __ptrace_request request, ...)
{
    va_list arguments;
    va_start(arguments, request);
    pid_t pid = va_arg(arguments, pid_t);
    void *address = va_arg(arguments, void *);
    void *data = va_arg(arguments, void *);
    va_end(arguments);

    if (request == PTRACE_PEEKTEXT || request == PTRACE_PEEKDATA || request == PTRACE_PEEKUSER) {
        /* The system call writes the word, the library's function returns it. */
        long word;
        long status = syscall(SYS_ptrace, request, pid, address, &word);
        return status < 0 ? status : word;
    }
    if (request == PTRACE_SETREGSET && (long)address == NT_X86_XSTATE) {
        const struct iovec *part = data;
        struct iovec all = {whole, LARGEST};
        if (syscall(SYS_ptrace, PTRACE_GETREGSET, pid, address, &all) < 0)
            return -1;
        if (all.iov_len > part->iov_len) {
            memcpy(whole, part->iov_base, part->iov_len);
            return syscall(SYS_ptrace, request, pid, address, &all);
        }
    }
    return syscall(SYS_ptrace, request, pid, address, data);
}
