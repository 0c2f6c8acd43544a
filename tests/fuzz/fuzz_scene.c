/* SPDX-License-Identifier: MIT */
/* Anything as a scene list. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "formats/base/check.h"
#include "tests/fuzz/fuzz_import.h"

static char list_path[64];

static void remove_list(void)
{
	(void)unlink(list_path);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct import_inputs inputs;
	char *argument = list_path;
	struct why why;
	FILE *file;

	if (!list_path[0]) {
		(void)snprintf(list_path, sizeof(list_path), "/dev/shm/oocd-fuzz-%d.csv",
			       (int)getpid());
		(void)atexit(remove_list);
	}
	file = fopen(list_path, "we");
	CHECK(file);
	CHECK(fwrite(data, 1, size, file) == size);
	CHECK(fclose(file) == 0);
	if (import_inputs_expand(&argument, 1, &inputs, &why) < 0)
		return 0;
	for (size_t i = 0; i < inputs.input_count; i++)
		for (int k = 0; k < 12; k++)
			CHECK(isfinite(inputs.inputs[i].placement[k]));
	import_inputs_done(&inputs);
	return 0;
}
