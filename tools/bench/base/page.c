/* SPDX-License-Identifier: MIT */
#include "tools/bench/base/page.h"

#include <errno.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const char style[] =
	"body{font:15px/1.45 sans-serif;color:#222;max-width:62em;margin:2em auto;padding:0 1em}"
	"h1,h2{font-weight:600}h2{margin-top:2em}"
	"table{border-collapse:collapse;margin:1em 0;font-size:14px}"
	"td,th{padding:.2em .7em;border-bottom:1px solid #ddd;text-align:right}"
	"td:first-child,th:first-child{text-align:left}tr.mark{font-weight:600;background:#f3f7e9}"
	"figure{display:inline-block;margin:.4em}figcaption{font-size:13px;color:#555}"
	"svg{max-width:100%;height:auto}";

struct page {
	FILE *out;
	char path[PATH_MAX];
	char temporary[PATH_MAX];
};

static void write_escaped(FILE *out, const char *text)
{
	for (; *text; text++) {
		switch (*text) {
		case '<':
			fputs("&lt;", out);
			break;
		case '>':
			fputs("&gt;", out);
			break;
		case '&':
			fputs("&amp;", out);
			break;
		default:
			fputc(*text, out);
			break;
		}
	}
}

int page_create(const char *path, const char *title, struct page **ret, struct why *why)
{
	struct page *page = calloc(1, sizeof(*page));

	if (!page)
		return why_set(why, -ENOMEM, "out of memory");
	if (snprintf(page->path, sizeof(page->path), "%s", path) >= (int)sizeof(page->path) ||
	    snprintf(page->temporary, sizeof(page->temporary), "%s.part", path) >=
		    (int)sizeof(page->temporary)) {
		free(page);
		return why_set(why, -ENAMETOOLONG, "%s: too long a name", path);
	}
	page->out = fopen(page->temporary, "we");
	if (!page->out) {
		int r = why_errno(why, -errno, "%s", path);

		free(page);
		return r;
	}
	fputs("<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>",
	      page->out);
	write_escaped(page->out, title);
	fprintf(page->out, "</title><style>%s</style></head><body>\n<h1>", style);
	write_escaped(page->out, title);
	fputs("</h1>\n", page->out);
	*ret = page;
	return 0;
}

int page_finish(struct page *page, struct why *why)
{
	bool failed;
	int r = 0;

	fputs("</body></html>\n", page->out);
	failed = ferror(page->out) != 0;
	if (fclose(page->out) != 0 || failed)
		r = why_set(why, -EIO, "%s: cannot be written", page->path);
	else if (rename(page->temporary, page->path) < 0)
		r = why_errno(why, -errno, "%s", page->path);
	if (r < 0)
		(void)unlink(page->temporary);
	free(page);
	return r;
}

struct page *page_abandon(struct page *page)
{
	if (!page)
		return NULL;
	(void)fclose(page->out);
	(void)unlink(page->temporary);
	free(page);
	return NULL;
}

void page_heading(struct page *page, const char *text)
{
	fputs("<h2>", page->out);
	write_escaped(page->out, text);
	fputs("</h2>\n", page->out);
}

void page_paragraph(struct page *page, const char *format, ...)
{
	char text[2048];
	va_list args;

	va_start(args, format);
	(void)vsnprintf(text, sizeof(text), format, args);
	va_end(args);
	fputs("<p>", page->out);
	write_escaped(page->out, text);
	fputs("</p>\n", page->out);
}

static void write_row(struct page *page, const char *const *cells, const char *tag)
{
	for (; *cells; cells++) {
		fprintf(page->out, "<%s>", tag);
		write_escaped(page->out, *cells);
		fprintf(page->out, "</%s>", tag);
	}
	fputs("</tr>\n", page->out);
}

void page_table_begin(struct page *page, const char *const *heads)
{
	fputs("<table><tr>", page->out);
	write_row(page, heads, "th");
}

void page_row(struct page *page, const char *const *cells, bool is_marked)
{
	fputs(is_marked ? "<tr class=\"mark\">" : "<tr>", page->out);
	write_row(page, cells, "td");
}

void page_table_end(struct page *page)
{
	fputs("</table>\n", page->out);
}

int page_svg(struct page *page, const char *path, struct why *why)
{
	FILE *file = fopen(path, "re");
	bool is_inside = false;
	char line[4096];

	if (!file)
		return why_errno(why, -errno, "%s", path);
	fputs("<figure>", page->out);
	/* What comes before the element (declaration, document type) has no place inside HTML. */
	while (fgets(line, sizeof(line), file)) {
		const char *from = line;

		if (!is_inside) {
			from = strstr(line, "<svg");
			is_inside = from != NULL;
		}
		if (from)
			fputs(from, page->out);
	}
	fputs("</figure>\n", page->out);
	(void)fclose(file);
	return 0;
}

static void write_base64(FILE *out, const uint8_t *bytes, size_t count)
{
	static const char digits[] =
		"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

	for (size_t i = 0; i < count; i += 3) {
		uint32_t word = (uint32_t)bytes[i] << 16;

		word |= i + 1 < count ? (uint32_t)bytes[i + 1] << 8 : 0;
		word |= i + 2 < count ? bytes[i + 2] : 0;
		fputc(digits[word >> 18], out);
		fputc(digits[word >> 12 & 63], out);
		fputc(i + 1 < count ? digits[word >> 6 & 63] : '=', out);
		fputc(i + 2 < count ? digits[word & 63] : '=', out);
	}
}

int page_image(struct page *page, const struct rgb_image *image, const char *caption)
{
	uint8_t *bytes;
	size_t count;

	if (rgb_image_encode(image, &bytes, &count) < 0)
		return -ENOMEM;
	fprintf(page->out, "<figure><img width=\"%u\" height=\"%u\" src=\"data:image/png;base64,",
		image->width, image->height);
	write_base64(page->out, bytes, count);
	fputs("\"><figcaption>", page->out);
	write_escaped(page->out, caption);
	fputs("</figcaption></figure>\n", page->out);
	free(bytes);
	return 0;
}
