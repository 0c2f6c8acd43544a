/* SPDX-License-Identifier: MIT */
#include "tools/bench/base/arguments.h"

#include <getopt.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include "formats/base/check.h"
#include "formats/base/text.h"
#include "tools/bench/base/verb.h"

/* Keys of options without a letter begin behind all letters. */
#define KEY_FIRST 256

static bool is_within(const struct argument *argument, double value)
{
	return value >= argument->min && (argument->max == 0 || value <= argument->max);
}

/* What would do, in one phrase. */
static const char *wanted(const struct argument *argument, char *ret, size_t ret_bytes)
{
	static const char *const kinds[] = {
		[ARGUMENT_FLAG] = "",
		[ARGUMENT_NUMBER] = "a whole number",
		[ARGUMENT_SIZE] = "a size like 256M",
		[ARGUMENT_REAL] = "a number",
		[ARGUMENT_TEXT] = "",
		[ARGUMENT_CHOICE] = "one of",
		[ARGUMENT_PICTURE] = "a size like 640x480",
	};
	size_t used = (size_t)snprintf(ret, ret_bytes, "%s", kinds[argument->kind]);

	if (argument->kind == ARGUMENT_CHOICE) {
		for (const char *const *choice = argument->choices; *choice; choice++)
			used += (size_t)snprintf(ret + used, ret_bytes - used, "%s %s",
						 choice == argument->choices ? "" : ",", *choice);
		return ret;
	}
	if (argument->max > 0)
		(void)snprintf(ret + used, ret_bytes - used, " from %.10g to %.10g", argument->min,
			       argument->max);
	else if (argument->min > 0)
		(void)snprintf(ret + used, ret_bytes - used, " of %.10g or more", argument->min);
	return ret;
}

static bool take_number(const struct argument *argument, const char *text)
{
	uint64_t number;
	int r = argument->kind == ARGUMENT_SIZE ? text_to_size(text, &number)
						: text_to_u64(text, &number);

	if (r < 0 || !is_within(argument, (double)number))
		return false;
	*(uint64_t *)argument->value = number;
	return true;
}

static bool take_real(const struct argument *argument, const char *text)
{
	double number;

	if (text_to_double(text, &number) < 0 || !is_within(argument, number))
		return false;
	*(double *)argument->value = number;
	return true;
}

static bool take_choice(const struct argument *argument, const char *text)
{
	for (unsigned i = 0; argument->choices[i]; i++) {
		if (strcmp(argument->choices[i], text) != 0)
			continue;
		*(unsigned *)argument->value = i;
		return true;
	}
	return false;
}

static bool take_picture(const struct argument *argument, const char *text)
{
	unsigned *size = argument->value;
	unsigned width;
	unsigned height;
	char rest;

	if (sscanf(text, "%ux%u%c", &width, &height, &rest) != 2 || width == 0 || height == 0 ||
	    !is_within(argument, width) || !is_within(argument, height))
		return false;
	size[0] = width;
	size[1] = height;
	return true;
}

static bool take(const struct argument *argument, const char *text)
{
	switch (argument->kind) {
	case ARGUMENT_FLAG:
		*(bool *)argument->value = true;
		return true;
	case ARGUMENT_NUMBER:
	case ARGUMENT_SIZE:
		return take_number(argument, text);
	case ARGUMENT_REAL:
		return take_real(argument, text);
	case ARGUMENT_TEXT:
		*(const char **)argument->value = text;
		return true;
	case ARGUMENT_CHOICE:
		return take_choice(argument, text);
	case ARGUMENT_PICTURE:
		return take_picture(argument, text);
	}
	return false;
}

static const struct argument *find(const struct argument *table, int key)
{
	for (int i = 0; table[i].name; i++)
		if (key == KEY_FIRST + i || (table[i].letter && key == table[i].letter))
			return &table[i];
	return NULL;
}

/* The table as getopt_long() wants it. */
static void make_options(const struct argument *table, struct option *ret_options,
			 char *ret_letters)
{
	unsigned count = 0;

	for (; table[count].name; count++) {
		const struct argument *argument = &table[count];
		bool has_value = argument->kind != ARGUMENT_FLAG;

		CHECK(count < ARGUMENT_COUNT_MAX);
		ret_options[count] = (struct option){
			.name = argument->name,
			.has_arg = has_value ? required_argument : no_argument,
			.val = KEY_FIRST + (int)count,
		};
		if (argument->letter) {
			*ret_letters++ = argument->letter;
			if (has_value)
				*ret_letters++ = ':';
		}
	}
	ret_options[count] = (struct option){ "help", no_argument, NULL, 'h' };
	ret_options[count + 1] = (struct option){ NULL, 0, NULL, 0 };
	*ret_letters++ = 'h';
	*ret_letters = '\0';
}

int arguments_parse(const struct arguments *arguments, int argc, char **argv, char ***ret_operands)
{
	struct option options[ARGUMENT_COUNT_MAX + 2];
	char letters[2 * ARGUMENT_COUNT_MAX + 2];
	char phrase[256];
	int key;

	make_options(arguments->table, options, letters);
	optind = 1;
	opterr = 0;
	while ((key = getopt_long(argc, argv, letters, options, NULL)) != -1) {
		const struct argument *argument = find(arguments->table, key);

		if (key == 'h') {
			fputs(arguments->help, stdout);
			return 0;
		}
		if (!argument)
			return verb_usage_error(arguments->verb,
						"%s: no such option, or without its value",
						argv[optind - 1]);
		if (!take(argument, optarg))
			return verb_usage_error(arguments->verb, "--%s %s is not %s",
						argument->name, optarg,
						wanted(argument, phrase, sizeof(phrase)));
	}
	if (argc - optind < arguments->operand_min ||
	    (arguments->operand_max >= 0 && argc - optind > arguments->operand_max))
		return verb_usage_error(arguments->verb, "%s", arguments->operand_usage);
	*ret_operands = &argv[optind];
	return ARGUMENTS_OK;
}
