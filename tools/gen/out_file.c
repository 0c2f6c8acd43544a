/* SPDX-License-Identifier: MIT */
#include "tools/gen/out_file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "formats/base/check.h"
#include "formats/base/file.h"
#include "tools/gen/interrupt.h"

#define TEXT_BYTES_MAX 1024

/* A temporary file beside the wanted one, so that the rename stays within its file system. */
static int open_temporary(struct out_file *out, struct why *why)
{
	mode_t mask;

	if (asprintf(&out->temporary_path, "%s.XXXXXX", out->path) < 0) {
		out->temporary_path = NULL;
		return why_set(why, -ENOMEM, "%s: out of memory", out->path);
	}
	out->fd = mkostemp(out->temporary_path, O_CLOEXEC);
	if (out->fd < 0) {
		int error = -errno;

		free(out->temporary_path);
		out->temporary_path = NULL;
		return why_errno(why, error, "%s: cannot be made", out->path);
	}
	/* mkostemp() gives 0600; the file is to have the mode of any other new file. */
	mask = umask(0);
	(void)umask(mask);
	(void)fchmod(out->fd, 0666 & ~mask);
	return 0;
}

int out_file_open(struct out_file *out, const char *path, struct why *why)
{
	struct stat status;
	int r = 0;

	*out = (struct out_file){ .fd = -1 };
	out->path = strdup(path);
	out->buffer = malloc(OUT_FILE_BUFFER_BYTES);
	if (!out->path || !out->buffer) {
		r = why_set(why, -ENOMEM, "%s: out of memory", path);
	} else if (strcmp(path, "-") == 0) {
		out->fd = fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3);
		if (out->fd < 0)
			r = why_errno(why, -errno, "standard output");
	} else if (stat(path, &status) == 0 && S_ISDIR(status.st_mode)) {
		r = why_errno(why, -EISDIR, "%s: cannot be written", path);
	} else if (stat(path, &status) == 0 && !S_ISREG(status.st_mode)) {
		out->fd = open(path, O_WRONLY | O_CLOEXEC);
		if (out->fd < 0)
			r = why_errno(why, -errno, "%s: cannot be written", path);
	} else {
		r = open_temporary(out, why);
	}
	if (r < 0)
		out_file_done(out);
	return r;
}

void out_file_flush(struct out_file *out)
{
	const uint8_t *bytes = out->buffer;
	size_t left_bytes = out->used_bytes;

	out->used_bytes = 0;
	while (left_bytes > 0 && out->error == 0) {
		ssize_t written;

		if (interrupted) {
			out->error = -ECANCELED;
			return;
		}
		written = write(out->fd, bytes, left_bytes);
		if (written < 0 && errno == EINTR)
			continue;
		if (written < 0) {
			out->error = -errno;
			return;
		}
		bytes += written;
		left_bytes -= (size_t)written;
	}
}

void out_file_printf(struct out_file *out, const char *format, ...)
{
	char text[TEXT_BYTES_MAX];
	va_list args;
	int length;

	va_start(args, format);
	length = vsnprintf(text, sizeof(text), format, args);
	va_end(args);
	CHECK(length >= 0 && (size_t)length < sizeof(text));
	if (out->used_bytes + (size_t)length > OUT_FILE_BUFFER_BYTES)
		out_file_flush(out);
	memcpy(out->buffer + out->used_bytes, text, (size_t)length);
	out->used_bytes += (size_t)length;
}

int out_file_commit(struct out_file *out, struct why *why)
{
	const char *name = strcmp(out->path, "-") == 0 ? "standard output" : out->path;

	out_file_flush(out);
	if (out->error == -ECANCELED)
		return why_set(why, -ECANCELED, "%s: interrupted, nothing was kept", name);
	/* Some file systems tell a full disk only when the file is closed. */
	if (out->error == 0 && close(out->fd) < 0)
		out->error = -errno;
	else if (out->error != 0)
		(void)fd_close(out->fd);
	out->fd = -1;
	if (out->error == 0 && out->temporary_path) {
		if (rename(out->temporary_path, out->path) < 0) {
			out->error = -errno;
		} else {
			free(out->temporary_path);
			out->temporary_path = NULL;
		}
	}
	if (out->error < 0)
		return why_errno(why, out->error, "%s: cannot be written", name);
	return 0;
}

void out_file_done(struct out_file *out)
{
	out->fd = fd_close(out->fd);
	if (out->temporary_path)
		(void)unlink(out->temporary_path);
	free(out->temporary_path);
	free(out->path);
	free(out->buffer);
	*out = (struct out_file){ .fd = -1 };
}
