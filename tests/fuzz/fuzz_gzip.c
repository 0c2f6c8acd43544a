/* SPDX-License-Identifier: MIT */
/* Anything as the bytes of a file, gzipped or not: all functions of a source, in turn. */
#include <stdio.h>
#include <sys/mman.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/file.h"
#include "formats/import/source.h"
#include "tests/fuzz/fuzz_import.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	AUTO_FD fd = memfd_create("fuzz", MFD_CLOEXEC);
	struct source *source = NULL;
	struct why why;
	char path[64];
	int r;

	CHECK(fd >= 0);
	CHECK(file_write_at(fd, data, size, 0) == 0);
	(void)snprintf(path, sizeof(path), "/proc/self/fd/%d", fd);
	r = source_open(path, 4 * MIB, NULL, NULL, &source, &why);
	for (unsigned i = 0; r >= 0; i++) {
		uint64_t rest_bytes = source_rest_max(source), before = source_offset(source);
		const char *line;
		size_t length;
		int64_t whole;
		double real;

		switch (i % 5) {
		case 0:
			r = source_line(source, &line, &length, &why);
			break;
		case 1:
			(void)source_double(source, &real, &why);
			break;
		case 2:
			(void)source_i64(source, &whole, &why);
			break;
		case 3:
			r = source_skip(source, i % 7, &why);
			break;
		default:
			r = source_blanks(source, &why);
		}
		CHECK(source->at <= source->end);
		CHECK(source_offset(source) - before <= rest_bytes);
		if (source->at == source->end && source_more(source, &why) <= 0)
			break;
	}
	source_close(source);
	return 0;
}
