"""Plays honestly, whatever the program that became this one did before."""
import hostile

hostile.play()
