/* SPDX-License-Identifier: MIT */
/**
 * fuzz_import.h - an importer fed with bytes in memory, and what must hold of what it says.
 */
#ifndef TESTS_FUZZ_FUZZ_IMPORT_H
#define TESTS_FUZZ_FUZZ_IMPORT_H

#include "formats/import/job.h"

/** What libFuzzer, or fuzz_main.c, calls. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

typedef int (*fuzz_importer_fn)(struct import_job *job, struct why *why);

/**
 * Imports the bytes twice, with plenty of memory and with next to none, and aborts when what comes
 * out breaks the rules of import.h, or differs.
 */
void fuzz_import(fuzz_importer_fn importer, const uint8_t *data, size_t size);

#endif /* TESTS_FUZZ_FUZZ_IMPORT_H */
