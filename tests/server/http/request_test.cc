// The syntax of requests: what is accepted, however it is split into pieces, and what is rejected
// because two parsers could read it differently.
#include "server/http/request.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace myograde::server {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Key;
using ::testing::Not;
using ::testing::Pair;

struct Read {
  Request head;
  ApiError error;
  bool good = false;
  std::string rest = {};  // of what came with its end
};

// Reads like a connection: `piece` bytes at a time.
Read ReadHead(const std::string& bytes, size_t piece = 1) {
  RequestParser parser;
  Read read;
  std::string in;
  for (size_t got = 0; got < bytes.size() && !read.good; got += piece) {
    in += bytes.substr(got, piece);
    in.erase(0, parser.TakeHead(in, read.head));
    read.good = parser.has_head();
    if (parser.error()) {
      read.error = *parser.error();
      return read;
    }
  }
  read.rest = in;
  return read;
}

TEST(Request, IsReadInAnyPieces) {
  const std::string text =
      "\r\nPOST /v1/artefacts?team=a%20b HTTP/1.1\r\nHost: x\r\nContent-Length: 12\r\n"
      "content-TYPE: Application/X-Tar; charset=x\r\nExpect: 100-continue\r\nRange: bytes=0-1\r\n"
      "X: y\r\n\r\n";
  for (size_t piece = 1; piece <= text.size(); ++piece) {
    const Read read = ReadHead(text + "body", piece);
    ASSERT_TRUE(read.good) << read.error.message;
    EXPECT_TRUE(std::string("body").starts_with(read.rest));
    EXPECT_EQ(read.head.method, "POST");
    EXPECT_EQ(read.head.path, "/v1/artefacts");
    EXPECT_EQ(read.head.content_type, "application/x-tar");
    EXPECT_EQ(read.head.length, 12);
    EXPECT_TRUE(read.head.expects_continue && read.head.keep_alive && !read.head.chunked);
    EXPECT_EQ(read.head.Param("team"), "a b");
    EXPECT_THAT(read.head.headers, Contains(Pair("x", "y")));
  }
}

TEST(Request, KeepsATokenApartAndTakesOneAlone) {
  const Read read = ReadHead("GET / HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer abc\r\n\r\n");
  ASSERT_TRUE(read.good) << read.error.message;
  EXPECT_EQ(read.head.authorization, "Bearer abc");
  EXPECT_THAT(read.head.headers, Not(Contains(Key("authorization"))));
  const Read two = ReadHead(
      "GET / HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer abc\r\nauthorization: Bearer abc\r\n\r\n");
  EXPECT_FALSE(two.good);
  EXPECT_THAT(two.error.message, HasSubstr("duplicate Authorization header"));
}

TEST(Request, SaysWhetherTheConnectionIsKept) {
  const auto kept = [](const std::string& rest) {
    const Read read = ReadHead("GET / " + rest + "\r\nHost: h\r\n\r\n");
    EXPECT_TRUE(read.good) << rest;
    return read.head.keep_alive;
  };
  EXPECT_TRUE(kept("HTTP/1.1"));
  EXPECT_FALSE(kept("HTTP/1.1\r\nConnection: close"));
  EXPECT_FALSE(kept("HTTP/1.1\r\nConnection: x, Close"));
  EXPECT_FALSE(kept("HTTP/1.0"));
  EXPECT_FALSE(kept("HTTP/1.0\r\nConnection: keep-alive"));
}

TEST(Request, HasOneHostUnlessItIsOld) {
  const auto host_of = [](const std::string& headers, const std::string& version = "1.1") {
    const Read read = ReadHead("GET / HTTP/" + version + "\r\n" + headers + "\r\n");
    return read.good ? read.head.host : std::to_string(read.error.http);
  };
  EXPECT_EQ(host_of("Host: Grader.Example.org:8443\r\n"), "grader.example.org");
  EXPECT_EQ(host_of("Host: [::1]:80\r\n"), "[::1]");
  EXPECT_EQ(host_of("Host: 127.0.0.1\r\n"), "127.0.0.1");
  EXPECT_EQ(host_of("Host:\r\n"), "");
  EXPECT_EQ(host_of("", "1.0"), "");
  for (const char* bad : {"", "Host: a\r\nHost: a\r\n", "Host: a b\r\n", "Host: a/b\r\n", "Host: a@b\r\n",
                          "Host: a:b\r\n", "Host: [::1\r\n", "Host: [x]\r\n", "Host: [::1]x\r\n"}) {
    EXPECT_EQ(host_of(bad), "400") << bad;
  }
  EXPECT_EQ(host_of("Host: a\r\nHost: a\r\n", "1.0"), "400");
  const Read absolute = ReadHead("GET http://Other.example:80/a?b HTTP/1.1\r\nHost: h\r\n\r\n");
  ASSERT_TRUE(absolute.good) << absolute.error.message;
  EXPECT_EQ(absolute.head.host, "other.example");
  EXPECT_EQ(absolute.head.path, "/a");
  EXPECT_TRUE(absolute.head.HasParam("b"));
}

TEST(Request, ItsAddressIsDecoded) {
  const Read read = ReadHead("GET /sign%2Din?to=/a?b=c?d&x=%41+%zz%2&&x=&y HTTP/1.1\r\nHost: h\r\n\r\n");
  ASSERT_TRUE(read.good) << read.error.message;
  EXPECT_EQ(read.head.path, "/sign-in");
  EXPECT_EQ(read.head.Param("to"), "/a?b=c?d");
  EXPECT_EQ(read.head.Param("x"), "A %zz%2");
  EXPECT_EQ(read.head.params.count("x"), 2u);
  EXPECT_TRUE(read.head.HasParam("y") && !read.head.HasParam("z"));
}

TEST(Request, WhatCanBeReadInTwoWaysIsRefused) {
  const std::string post = "POST / HTTP/1.1\r\nHost: localhost\r\n";
  const std::vector<std::pair<std::string, int>> bad = {
      {post + "Content-Length: 1\r\nContent-Length: 1\r\n\r\n", 400},
      {post + "Content-Length: 1\r\nTransfer-Encoding: chunked\r\n\r\n", 400},
      {post + "Transfer-Encoding: gzip, chunked\r\n\r\n", 501},
      {post + "Transfer-Encoding: chunked\r\nTransfer-Encoding: chunked\r\n\r\n", 400},
      {post + "Content-Length: +1\r\n\r\n", 400},
      {post + "Content-Length: -1\r\n\r\n", 400},
      {post + "Content-Length: 0x1\r\n\r\n", 400},
      {post + "Content-Length: 1, 1\r\n\r\n", 400},
      {post + "Content-Length: 9999999999999999999\r\n\r\n", 400},
      {post + "Content-Length:\r\n\r\n", 400},
      {post + "Content-Length : 1\r\n\r\n", 400},
      {post + "Content-Type: a\r\nContent-Type: b\r\n\r\n", 400},
      {post + "Content-Encoding: gzip\r\n\r\n", 415},
      {post + "Expect: 200-maybe\r\n\r\n", 417},
      {post + "A: b\r\n c\r\n\r\n", 400},
      {post + "no colon\r\n\r\n", 400},
      {post + ": b\r\n\r\n", 400},
      {"GET / HTTP/1.1\nA: b\r\n\r\n", 400},
      {"GET / HTTP/1.1\r\nHost: localhost\r\nA: b\rc\r\n\r\n", 400},
      {std::string("GET / HTTP/1.1\r\nHost: localhost\r\nA: b\0c\r\n\r\n", 44), 400},
      {"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1\r\n\r\n", 400},
      {"GET /  HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET http://x HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET ftp://x/ HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET http://a@b/ HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET /\xc3\xa4 HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET / HTTP/2.0\r\n\r\n", 505},
      {"G(T / HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET\r\n\r\n", 400},
      {"GET /" + std::string(9000, 'a') + " HTTP/1.1\r\n\r\n", 414},
      {"GET / HTTP/1.1\r\nHost: localhost\r\nA: " + std::string(9000, 'a') + "\r\n\r\n", 431},
      {"GET / HTTP/1.1\r\nHost: localhost\r\n" + std::string(40000, 'a'), 431},
      {"GET / HTTP/1.1\r\nHost: localhost\r\n" + [] {
         std::string lines;
         for (int i = 0; i < 200; ++i) lines += "A: b\r\n";
         return lines;
       }() + "\r\n", 431}};
  for (const auto& [text, http] : bad) {
    for (const size_t piece : {size_t{1}, size_t{7}, text.size()}) {
      const Read read = ReadHead(text, piece);
      EXPECT_FALSE(read.good) << text;
      EXPECT_EQ(read.error.http, http) << text << ": " << read.error.message;
      EXPECT_THAT(read.error.message, Not(HasSubstr("\n")));
    }
  }
}

struct Taken {
  std::string body;
  std::string rest;
  bool done = false;
  int error = 0;
};

// Of a body that comes behind this head, with `most` bytes.
Taken TakeBody(const std::string& header, std::string_view bytes, size_t piece, int64_t most = 100) {
  RequestParser parser;
  Request head;
  parser.TakeHead("POST / HTTP/1.1\r\nHost: h\r\n" + header + "\r\n\r\n", head);
  parser.BeginBody(head, most);
  Taken taken;
  std::string in;
  for (size_t got = 0; got < bytes.size() && !parser.error(); got += piece) {
    in += bytes.substr(got, piece);
    if (!parser.done()) in.erase(0, parser.TakeBody(in, taken.body));
  }
  taken.rest = in;
  taken.done = parser.done();
  taken.error = parser.error() ? parser.error()->http : 0;
  return taken;
}

const char kChunked[] = "Transfer-Encoding: chunked";

TEST(RequestParser, TakesWhatIsTheBodysAndNoMore) {
  for (size_t piece = 1; piece < 30; ++piece) {
    const Taken plain = TakeBody("Content-Length: 5", "helloGET", piece);
    EXPECT_TRUE(plain.done);
    EXPECT_EQ(plain.body, "hello");
    EXPECT_EQ(plain.rest, "GET");
    const Taken chunks = TakeBody(
        kChunked, "3\r\nhel\r\n2;name=value\r\nlo\r\n00\r\nTrailer: x\r\n\r\nGET", piece);
    EXPECT_TRUE(chunks.done) << chunks.error;
    EXPECT_EQ(chunks.body, "hello");
    EXPECT_EQ(chunks.rest, "GET");
  }
  EXPECT_FALSE(TakeBody("Content-Length: 5", "hell", 1).done);
  EXPECT_FALSE(TakeBody(kChunked, "3\r\nhel\r\n0\r\n", 1).done) << "the last line is missing";
}

TEST(RequestParser, BrokenChunksAndLongBodiesAreRefused) {
  for (const char* text :
       {"x\r\n", "\r\n", "-1\r\n", "0x3\r\n\r\n", "3\nabc\r\n", "3\r\nabcd\r\n\r\n", "+3\r\nabc\r\n",
        "fffffffffffffffff\r\n"}) {
    for (const size_t piece : {1, 3, 100}) {
      EXPECT_EQ(TakeBody(kChunked, text, piece).error, 400) << text;
    }
  }
  EXPECT_EQ(TakeBody(kChunked, std::string(40000, '1'), 1000).error, 400);
  EXPECT_EQ(TakeBody(kChunked, "65\r\n", 1).error, 413) << "101 bytes";
  EXPECT_EQ(TakeBody(kChunked, "64\r\n" + std::string(100, 'a') + "\r\n1\r\n", 9).error, 413);
  std::string trailers = "0\r\n";
  for (int i = 0; i < 10'000; ++i) trailers += "A: b\r\n";
  EXPECT_EQ(TakeBody(kChunked, trailers, 1000).error, 400);
  EXPECT_EQ(TakeBody("Content-Length: 101", "a", 1).error, 413);
}

}  // namespace
}  // namespace myograde::server
