/* SPDX-License-Identifier: MIT */
#include "formats/base/why.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

int why_set(struct why *why, int error, const char *format, ...)
{
	va_list args;

	if (!why)
		return error;
	va_start(args, format);
	(void)vsnprintf(why->text, sizeof(why->text), format, args);
	va_end(args);
	return error;
}

int why_errno(struct why *why, int error, const char *format, ...)
{
	va_list args;
	char message[128];
	size_t length;

	if (!why)
		return error;
	va_start(args, format);
	(void)vsnprintf(why->text, sizeof(why->text), format, args);
	va_end(args);
	length = strlen(why->text);
	(void)snprintf(why->text + length, sizeof(why->text) - length, ": %s",
		       strerror_r(-error, message, sizeof(message)));
	return error;
}

void why_prefix(struct why *why, const char *format, ...)
{
	va_list args;
	char text[WHY_TEXT_BYTES];
	size_t length;

	if (!why)
		return;
	memcpy(text, why->text, sizeof(text));
	va_start(args, format);
	(void)vsnprintf(why->text, sizeof(why->text), format, args);
	va_end(args);
	length = strlen(why->text);
	(void)snprintf(why->text + length, sizeof(why->text) - length, ": %.*s",
		       (int)(sizeof(text) - 3), text);
}
