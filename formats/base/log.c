/* SPDX-License-Identifier: MIT */
#include "formats/base/log.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "formats/base/check.h"

#define LOG_LINE_BYTES 1024

static const char *log_name = "oocd";
static enum log_level log_level_max = LOG_LEVEL_INFO;
static bool log_to_journal;

/* The service manager names the journal's stream in the environment: "device:inode". */
static bool stderr_is_journal(void)
{
	const char *stream = getenv("JOURNAL_STREAM");
	unsigned long long device;
	unsigned long long inode;
	struct stat status;

	if (!stream || sscanf(stream, "%llu:%llu", &device, &inode) != 2)
		return false;
	return fstat(STDERR_FILENO, &status) == 0 && status.st_dev == device &&
	       status.st_ino == inode;
}

void log_init(const char *program, enum log_level level_max)
{
	log_name = program;
	log_level_max = level_max;
	log_to_journal = stderr_is_journal();
}

const char *log_program(void)
{
	return log_name;
}

void log_write(enum log_level level, const char *format, ...)
{
	char line[LOG_LINE_BYTES];
	size_t length;
	va_list args;

	if (level > log_level_max)
		return;
	if (log_to_journal)
		(void)snprintf(line, sizeof(line), "<%d>", level);
	else
		(void)snprintf(line, sizeof(line), "%s: ", log_name);
	length = strlen(line);
	va_start(args, format);
	(void)vsnprintf(line + length, sizeof(line) - length - 1, format, args);
	va_end(args);
	length = strlen(line);
	line[length++] = '\n';
	/* One write a line, so that lines of several threads and processes do not mix. */
	if (write(STDERR_FILENO, line, length) < 0)
		return;
}

_Noreturn void check_failed(const char *condition, const char *file, int line)
{
	log_error("bug: %s does not hold at %s:%d", condition, file, line);
	abort();
}
