/* SPDX-License-Identifier: MIT */
#include "tools/bench/base/verb.h"

#include <stdarg.h>
#include <stdio.h>

#include "formats/base/log.h"

int verb_usage_error(const char *verb, const char *format, ...)
{
	char text[512];
	va_list args;

	va_start(args, format);
	(void)vsnprintf(text, sizeof(text), format, args);
	va_end(args);
	log_error("%s: %s; oocbench %s --help says more", verb, text, verb);
	return 2;
}

int verb_status(const char *verb, int r, const struct why *why)
{
	if (r < 0)
		log_error("%s: %s", verb, why->text);
	return r < 0 ? 1 : 0;
}
