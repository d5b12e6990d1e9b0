// Base class of tests of a command-line program: exit code, output, and files in a temporary folder.
#ifndef PLIANT_TEST_PROGRAM_H
#define PLIANT_TEST_PROGRAM_H

#include <gtest/gtest.h>

#include <csignal>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>

#include <sys/wait.h>
#include <unistd.h>

class Program : public testing::Test {
protected:
    explicit Program(const char *program) : program_(program) {}
    void SetUp() override { ASSERT_NE(mkdtemp(folder_), nullptr); }
    void TearDown() override { EXPECT_EQ(std::system(("rm -r " + std::string(folder_)).c_str()), 0); }
    std::string in(const std::string &name) const { return std::string(folder_) + "/" + name; }
    // Run the program and keep its stdout and stderr. Return its exit code.
    int run(const std::string &arguments)
    {
        int code = std::system((program_ + " " + arguments + " > " + in("out") + " 2> " + in("err")).c_str());
        out_ = text(in("out"));
        err_ = text(in("err"));
        return WIFEXITED(code) ? WEXITSTATUS(code) : -1;
    }
    // Start the program and interrupt it (Ctrl-C) once it is ready. Return its exit code, also if it ends earlier.
    template <class Ready> int interrupt(const std::string &arguments, const Ready &ready)
    {
        const std::string command = "exec " + program_ + " " + arguments + " > " + in("out") + " 2> " + in("err");
        pid_t child = fork();
        if (child == 0) {
            execl("/bin/sh", "sh", "-c", command.c_str(), static_cast<char *>(nullptr));
            _exit(127);
        }
        int state = 0;
        pid_t ended = 0;
        while (ended == 0 && !ready()) {
            usleep(20000);
            ended = waitpid(child, &state, WNOHANG);
        }
        if (ended == 0) {
            kill(child, SIGINT);
            ended = waitpid(child, &state, 0);
        }
        return ended == child && WIFEXITED(state) ? WEXITSTATUS(state) : -1;
    }
    static std::string text(const std::string &path)
    {
        std::ifstream file(path);
        std::stringstream all;
        all << file.rdbuf();
        return all.str();
    }
    const std::string program_;
    char folder_[32] = "/tmp/pliant_program_XXXXXX";
    std::string out_, err_;
};

#endif
