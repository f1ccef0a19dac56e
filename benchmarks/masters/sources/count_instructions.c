/* Counts the instructions that a program executes between two signals that it sends to itself.
 *
 *     count_instructions PROGRAM ARGUMENT...
 *
 * SIGUSR1 begins, SIGUSR2 ends; each pair prints a line with a number. For Linux: it steps by ptrace.
 */
#include <signal.h>
#include <stdio.h>
#include <sys/ptrace.h>
#include <sys/wait.h>
#include <unistd.h>

int main(int n, char **arguments) {
    if (n < 2) return 2;
    pid_t child = fork();
    if (child == 0) {
        ptrace(PTRACE_TRACEME, 0, 0, 0);
        execvp(arguments[1], arguments + 1);
        _exit(127);
    }
    int status, counting = 0;
    long count = 0;
    while (waitpid(child, &status, 0) == child && WIFSTOPPED(status)) {
        int delivered = 0;
        switch (WSTOPSIG(status)) {
        case SIGTRAP: count += counting; break;
        case SIGUSR1: counting = 1; count = 0; break;
        case SIGUSR2:
            counting = 0;
            printf("%ld\n", count);
            fflush(stdout);
            break;
        default: delivered = WSTOPSIG(status);
        }
        ptrace(counting ? PTRACE_SINGLESTEP : PTRACE_CONT, child, 0, delivered);
    }
    return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}
