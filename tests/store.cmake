# SPDX-License-Identifier: MIT
# The helper that tests of every area may link.
add_library(oocd_test_helper STATIC
	${CMAKE_CURRENT_LIST_DIR}/helper.c ${CMAKE_CURRENT_LIST_DIR}/helper_grid.c
	${CMAKE_CURRENT_LIST_DIR}/store_image.c)
target_link_libraries(oocd_test_helper PUBLIC oocd_flags oocd_store PkgConfig::CMOCKA
	PRIVATE PkgConfig::ZSTD m)

oocd_test(test_store unit SOURCES unit/test_store.c LINK oocd_test_helper)
oocd_test(test_store_layout unit SOURCES unit/test_store_layout.c LINK oocd_test_helper)
oocd_test(test_store_judge unit SOURCES unit/test_store_judge.c LINK oocd_test_helper)
oocd_test(test_store_damage unit SOURCES unit/test_store_damage.c LINK oocd_test_helper)
oocd_test(test_payload unit SOURCES unit/test_payload.c LINK oocd_test_helper m)
oocd_test(test_codec unit SOURCES unit/test_codec.c LINK oocd_test_helper)
oocd_test(fault_store fault SOURCES fault/fault_store.c LINK oocd_test_helper TIMEOUT 120)
target_link_options(fault_store PRIVATE
	-Wl,--wrap=malloc,--wrap=calloc,--wrap=aligned_alloc,--wrap=strdup,--wrap=realpath
	-Wl,--wrap=open64,--wrap=openat64,--wrap=fstat64,--wrap=pread64,--wrap=pwrite64
	-Wl,--wrap=fsync,--wrap=linkat,--wrap=renameat)
