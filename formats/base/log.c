/* SPDX-License-Identifier: MIT */
#include "formats/base/log.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"

#define LOG_LINE_BYTES 1024
#define JOURNAL_BYTES  4096u

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

static void write_line(enum log_level level, const char *text)
{
	char line[LOG_LINE_BYTES + 64];
	size_t length;

	if (log_to_journal)
		(void)snprintf(line, sizeof(line) - 1, "<%d>%s", level, text);
	else
		(void)snprintf(line, sizeof(line) - 1, "%s: %s", log_name, text);
	length = strlen(line);
	line[length++] = '\n';
	/* One write a line, so that lines of several threads and processes do not mix. */
	if (write(STDERR_FILENO, line, length) < 0)
		return;
}

/* A field ends at its line's end, so a value has none. */
static void add_field(char *message, size_t *length, const char *name, const char *value)
{
	int n = snprintf(message + *length, JOURNAL_BYTES - *length, "%s=%s", name, value);
	size_t from = *length;

	*length = u64_min(from + (size_t)n, JOURNAL_BYTES - 2);
	for (size_t i = from; i < *length; i++)
		if (message[i] == '\n')
			message[i] = ' ';
	message[(*length)++] = '\n';
}

/*
 * The journal's own protocol: a datagram of lines "NAME=value".
 * Source: systemd, docs/JOURNAL_NATIVE_PROTOCOL.md.
 */
static bool send_to_journal(enum log_level level, const struct log_field *fields,
			    size_t field_count, const char *text)
{
	const struct sockaddr_un address = {
		.sun_family = AF_UNIX,
		.sun_path = "/run/systemd/journal/socket",
	};
	char message[JOURNAL_BYTES];
	char priority[16];
	size_t length = 0;
	ssize_t sent;
	int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);

	if (fd < 0)
		return false;
	(void)snprintf(priority, sizeof(priority), "%d", level);
	add_field(message, &length, "MESSAGE", text);
	add_field(message, &length, "PRIORITY", priority);
	add_field(message, &length, "SYSLOG_IDENTIFIER", log_name);
	for (size_t i = 0; i < field_count; i++)
		add_field(message, &length, fields[i].name, fields[i].value);
	sent = sendto(fd, message, length, MSG_NOSIGNAL, (const struct sockaddr *)&address,
		      sizeof(address));
	(void)close(fd);
	return sent == (ssize_t)length;
}

void log_write(enum log_level level, const char *format, ...)
{
	char text[LOG_LINE_BYTES];
	va_list args;

	if (level > log_level_max)
		return;
	va_start(args, format);
	(void)vsnprintf(text, sizeof(text), format, args);
	va_end(args);
	write_line(level, text);
}

void log_write_about(enum log_level level, const struct log_field *fields, size_t field_count,
		     const char *format, ...)
{
	char text[LOG_LINE_BYTES];
	va_list args;

	if (level > log_level_max)
		return;
	va_start(args, format);
	(void)vsnprintf(text, sizeof(text), format, args);
	va_end(args);
	if (!log_to_journal || !send_to_journal(level, fields, field_count, text))
		write_line(level, text);
}

_Noreturn void check_failed(const char *condition, const char *file, int line)
{
	log_error("bug: %s does not hold at %s:%d", condition, file, line);
	abort();
}
