# SPDX-License-Identifier: MIT
oocd_test(test_build_spool unit SOURCES unit/test_build_spool.c LINK oocd_build oocd_test_helper)
oocd_test(test_build_grid unit SOURCES unit/test_build_grid.c LINK oocd_build oocd_test_helper m)
oocd_test(test_build_normals unit SOURCES unit/test_build_normals.c
	LINK oocd_build oocd_test_helper m)
oocd_test(test_oocbuild integration SOURCES integration/test_oocbuild.c integration/models.c
	LINK oocd_build oocd_test_helper m TIMEOUT 300)
add_dependencies(test_oocbuild oocbuild oocctl oocgen)
oocd_test(fault_build fault SOURCES fault/fault_build.c integration/models.c
	LINK oocd_build oocd_test_helper m TIMEOUT 120)
target_link_options(fault_build PRIVATE
	-Wl,--wrap=malloc,--wrap=calloc,--wrap=realloc,--wrap=reallocarray,--wrap=aligned_alloc
	-Wl,--wrap=strdup,--wrap=strndup)
