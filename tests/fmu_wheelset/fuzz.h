#ifndef FUZZ_H
#define FUZZ_H

/* Whether each of many random calls gave a legal status, and one line of text exactly if it was not OK. */
int random_calls_are_lawful(void);

#endif
