"""Plays honestly, whatever the program that executed this one did before."""
import hostile

hostile.play()
