/* SPDX-License-Identifier: MIT */
#include "formats/base/file.h"

#include <errno.h>

int fd_close(int fd)
{
	int saved = errno;

	if (fd >= 0)
		(void)close(fd);
	errno = saved;
	return -1;
}

int file_read_at(int fd, void *data, size_t size_bytes, uint64_t file_offset)
{
	uint8_t *bytes = data;

	while (size_bytes > 0) {
		ssize_t n = pread(fd, bytes, size_bytes, (off_t)file_offset);

		if (n < 0 && errno == EINTR)
			continue;
		if (n < 0)
			return -errno;
		if (n == 0)
			return -ENODATA;
		bytes += n;
		size_bytes -= (size_t)n;
		file_offset += (uint64_t)n;
	}
	return 0;
}

int file_write_at(int fd, const void *data, size_t size_bytes, uint64_t file_offset)
{
	const uint8_t *bytes = data;

	while (size_bytes > 0) {
		ssize_t n = pwrite(fd, bytes, size_bytes, (off_t)file_offset);

		if (n < 0 && errno == EINTR)
			continue;
		if (n < 0)
			return -errno;
		/* A write of nothing without an error would loop for ever. */
		if (n == 0)
			return -EIO;
		bytes += n;
		size_bytes -= (size_t)n;
		file_offset += (uint64_t)n;
	}
	return 0;
}
