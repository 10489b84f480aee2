# The daemon's API: messages and services in one library of its own, generated once, with little optimisation: its
# time goes into copying bytes, not into this code.
find_package(gRPC REQUIRED)
set_property(TARGET re2::re2 PROPERTY INTERFACE_COMPILE_OPTIONS "")  # -pthread spoils the precompiled header
set(api_names devices capture live cases jobs)
set(api_sources "")
foreach(name ${api_names})
  set(proto gnathion/v1/${name}.proto)
  set(stem ${CMAKE_BINARY_DIR}/proto_gen/gnathion/v1/${name})
  add_custom_command(OUTPUT ${stem}.pb.cc ${stem}.pb.h ${stem}.grpc.pb.cc ${stem}.grpc.pb.h
    COMMAND protobuf::protoc --cpp_out ${CMAKE_BINARY_DIR}/proto_gen --grpc_out ${CMAKE_BINARY_DIR}/proto_gen
      --plugin=protoc-gen-grpc=$<TARGET_FILE:gRPC::grpc_cpp_plugin> -I ${CMAKE_SOURCE_DIR}/proto ${proto}
    DEPENDS ${CMAKE_SOURCE_DIR}/proto/${proto} VERBATIM)
  list(APPEND api_sources ${stem}.pb.cc ${stem}.grpc.pb.cc)
  set_source_files_properties(${stem}.pb.cc PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
endforeach()
add_library(gn_api STATIC ${api_sources})
target_link_libraries(gn_api PUBLIC gn_proto gRPC::grpc++)
target_include_directories(gn_api SYSTEM PUBLIC ${CMAKE_BINARY_DIR}/proto_gen)
target_compile_options(gn_api PRIVATE -w -O1)
set_target_properties(gn_api PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 12)
