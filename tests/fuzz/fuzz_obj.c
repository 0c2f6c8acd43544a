/* SPDX-License-Identifier: MIT */
#include "tests/fuzz/fuzz_import.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	fuzz_import(obj_import, data, size);
	return 0;
}
