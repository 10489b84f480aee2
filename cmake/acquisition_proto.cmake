# The message types of recordings, generated from proto/ with that folder as the import root.
file(GLOB_RECURSE proto_files CONFIGURE_DEPENDS RELATIVE ${CMAKE_SOURCE_DIR}/proto ${CMAKE_SOURCE_DIR}/proto/*.proto)
list(FILTER proto_files EXCLUDE REGEX "v1/(devices|capture|live|cases|jobs)\\.proto$")  # the API: api_proto.cmake
set(proto_out ${CMAKE_BINARY_DIR}/proto_gen)
file(MAKE_DIRECTORY ${proto_out})
set(proto_sources "")
foreach(proto ${proto_files})
  string(REGEX REPLACE "\\.proto$" "" stem ${proto})
  add_custom_command(OUTPUT ${proto_out}/${stem}.pb.cc ${proto_out}/${stem}.pb.h
    COMMAND protobuf::protoc --cpp_out ${proto_out} -I ${CMAKE_SOURCE_DIR}/proto ${proto}
    DEPENDS ${CMAKE_SOURCE_DIR}/proto/${proto} VERBATIM)
  list(APPEND proto_sources ${proto_out}/${stem}.pb.cc)
endforeach()
add_library(gn_proto STATIC ${proto_sources})
target_link_libraries(gn_proto PUBLIC protobuf::libprotobuf)
target_include_directories(gn_proto SYSTEM PUBLIC ${proto_out})
target_compile_options(gn_proto PRIVATE -w)
