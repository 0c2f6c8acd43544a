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
oocd_test(test_store_damage unit SOURCES unit/test_store_damage.c LINK oocd_test_helper SKIPS_TSAN)
oocd_test(test_payload unit SOURCES unit/test_payload.c LINK oocd_test_helper m)
oocd_test(test_codec unit SOURCES unit/test_codec.c LINK oocd_test_helper)
oocd_test(test_store_writer unit
	SOURCES unit/test_store_writer.c ${CMAKE_SOURCE_DIR}/formats/store/store_writer.c
	LINK oocd_test_helper PkgConfig::XXHASH PkgConfig::ZSTD)
target_compile_definitions(test_store_writer PRIVATE OOCD_UNIT_TESTING)
oocd_test(fault_store fault SOURCES fault/fault_store.c LINK oocd_test_helper TIMEOUT 120)
target_link_options(fault_store PRIVATE
	-Wl,--wrap=malloc,--wrap=calloc,--wrap=aligned_alloc,--wrap=strdup,--wrap=realpath
	-Wl,--wrap=open64,--wrap=openat64,--wrap=fstat64,--wrap=pread64,--wrap=pwrite64
	-Wl,--wrap=fsync,--wrap=linkat,--wrap=renameat)

# oocd_fuzz(NAME LINK lib...): a fuzzer of tests/fuzz and its corpus as an ordinary test.  With
# -DOOCD_FUZZ=ON and clang it is a libFuzzer program: build/.../tests/NAME tests/fuzz/corpus/NAME
option(OOCD_FUZZ "Build the fuzzers with libFuzzer (clang only)" OFF)
function(oocd_fuzz name)
	cmake_parse_arguments(F "" "" "LINK" ${ARGN})
	if(OOCD_FUZZ)
		add_executable(${name} fuzz/${name}.c)
		target_compile_options(${name} PRIVATE -fsanitize=fuzzer)
		target_link_options(${name} PRIVATE -fsanitize=fuzzer)
		target_link_libraries(${name} PRIVATE oocd_flags ${F_LINK})
		set_target_properties(${name} PROPERTIES
			RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
	else()
		oocd_test(${name} fuzz SOURCES fuzz/${name}.c fuzz/fuzz_main.c LINK ${F_LINK}
			ARGS ${CMAKE_CURRENT_SOURCE_DIR}/fuzz/corpus/${name})
	endif()
endfunction()

oocd_fuzz(fuzz_store_open LINK oocd_test_helper)
oocd_fuzz(fuzz_payload LINK oocd_store)
oocd_fuzz(fuzz_codec LINK oocd_store)
oocd_test(test_golden_store golden SOURCES golden/test_golden_store.c LINK oocd_test_helper)

oocd_test(test_oocctl integration SOURCES integration/test_oocctl.c integration/triangles.c
	LINK oocd_test_helper PkgConfig::JANSSON)
add_dependencies(test_oocctl oocctl)
oocd_test(test_oocctl_daemon integration SOURCES integration/test_oocctl_daemon.c
	LINK oocd_daemon_kit PkgConfig::JANSSON)
add_dependencies(test_oocctl_daemon oocctl)
oocd_test(test_oocctl_steer integration SOURCES integration/test_oocctl_steer.c
	openmetrics_judge.c LINK oocd_daemon_kit PkgConfig::JANSSON)
add_dependencies(test_oocctl_steer oocctl)
oocd_test(test_export integration SOURCES integration/test_export.c integration/triangles.c
	LINK oocd_test_helper m TIMEOUT 120)
add_dependencies(test_export oocctl oocbuild oocgen)
