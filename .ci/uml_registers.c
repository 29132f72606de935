// For User Mode Linux on a processor whose extended registers take more room than it has for them, such as one with AMX:
// the host's kernel restores all of them or none (PTRACE_SETREGSET of NT_X86_XSTATE fails with EFAULT), and the guest
// dies before its first process. Preloaded, this makes up the rest with zeros, the initial state of those registers; no
// guest uses them without asking.
#define _GNU_SOURCE
#include <errno.h>
#include <stdarg.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

enum { LAST_PEEK = 3, GET_REGISTERS = 0x4204, SET_REGISTERS = 0x4205, EXTENDED = 0x202 };
static char whole[1 << 16] __attribute__((aligned(64)));
static size_t whole_size;

static long kernel_ptrace(long request, long pid, void *address, void *data) {
    return syscall(SYS_ptrace, request, pid, address, data);
}

static long extended_registers(long request, long pid, void *address, struct iovec *part) {
    struct iovec all = {whole, sizeof whole};
    if (request == GET_REGISTERS) {
        const long result = kernel_ptrace(request, pid, address, &all);
        if (result >= 0) {
            whole_size = all.iov_len;
            if (part->iov_len > whole_size) part->iov_len = whole_size;
            memcpy(part->iov_base, whole, part->iov_len);
        }
        return result;
    }
    if (part->iov_len >= whole_size) return kernel_ptrace(request, pid, address, part);
    memset(whole, 0, whole_size);
    memcpy(whole, part->iov_base, part->iov_len);
    all.iov_len = whole_size;
    return kernel_ptrace(request, pid, address, &all);
}

long ptrace(int request, ...) {
    va_list arguments;
    va_start(arguments, request);
    const long pid = va_arg(arguments, int);
    void *const address = va_arg(arguments, void *);
    void *const data = va_arg(arguments, void *);
    va_end(arguments);
    if ((request == GET_REGISTERS || request == SET_REGISTERS) && (long)address == EXTENDED)
        return extended_registers(request, pid, address, data);
    if (request < 1 || request > LAST_PEEK) return kernel_ptrace(request, pid, address, data);
    long word;  // the system call stores what the library's function returns
    if (kernel_ptrace(request, pid, address, &word) < 0) return -1;
    errno = 0;
    return word;
}
