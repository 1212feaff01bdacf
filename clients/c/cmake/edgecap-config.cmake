# find_package(edgecap REQUIRED)
# target_link_libraries(app PRIVATE edgecap::edgecap)    # or edgecap::static, which needs no library at run time
get_filename_component(_edgecap_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)

if(NOT TARGET edgecap::edgecap)
  add_library(edgecap::edgecap SHARED IMPORTED)
  set_target_properties(edgecap::edgecap PROPERTIES
    IMPORTED_LOCATION "${_edgecap_prefix}/lib/libedgecap_c.so"
    INTERFACE_INCLUDE_DIRECTORIES "${_edgecap_prefix}/include")
  add_library(edgecap::static STATIC IMPORTED)
  set_target_properties(edgecap::static PROPERTIES
    IMPORTED_LOCATION "${_edgecap_prefix}/lib/libedgecap_c.a"
    INTERFACE_INCLUDE_DIRECTORIES "${_edgecap_prefix}/include"
    INTERFACE_LINK_LIBRARIES "gcc_s;util;rt;pthread;m;dl")
endif()

unset(_edgecap_prefix)
