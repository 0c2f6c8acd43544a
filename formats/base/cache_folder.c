/* SPDX-License-Identifier: MIT */
#include "formats/base/cache_folder.h"

#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

static int make_folders(char *path)
{
	for (char *slash = path + 1; slash && *slash; slash++) {
		slash = strchr(slash, '/');
		if (!slash)
			break;
		*slash = '\0';
		if (mkdir(path, 0700) < 0 && errno != EEXIST) {
			int r = -errno;

			*slash = '/';
			return r;
		}
		*slash = '/';
	}
	return mkdir(path, 0700) < 0 && errno != EEXIST ? -errno : 0;
}

int cache_folder_make(char path[PATH_MAX], struct why *why)
{
	const char *cache = getenv("XDG_CACHE_HOME");
	const char *home = getenv("HOME");
	int r;

	if (cache && cache[0] == '/')
		(void)snprintf(path, PATH_MAX, "%s/oocd", cache);
	else if (home && home[0] == '/')
		(void)snprintf(path, PATH_MAX, "%s/.cache/oocd", home);
	else
		return why_set(why, -ENOENT,
			       "a place for what is kept: neither $XDG_CACHE_HOME nor "
			       "$HOME is set");
	r = make_folders(path);
	return r < 0 ? why_errno(why, r, "%s", path) : 0;
}
