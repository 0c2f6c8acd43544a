/* SPDX-License-Identifier: MIT */
/* Writes the small store of helper.h, for tests that are shell scripts. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>

#include "tests/helper.h"

int main(int argc, char **argv)
{
	if (argc != 2) {
		(void)fprintf(stderr, "Usage: make_grid_store FILE\n");
		return 2;
	}
	test_store_grid(argv[1], 8);
	return 0;
}
